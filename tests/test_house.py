"""The rules of the house, read off the source itself. Each failure names the file, the line and the rule."""

from __future__ import annotations

import ast
import hashlib
import importlib
import itertools
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import trundle

CHECKOUT = Path(__file__).resolve().parents[1]
SOURCE = CHECKOUT / "src" / "trundle"
MODULES = sorted(SOURCE.rglob("*.py"))
FOLDERS = [CHECKOUT / name for name in ("tests", "benchmarks", "examples", "docs")]
SCRIPTS = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
TREES = {path: ast.parse(path.read_text(encoding="utf-8"), str(path)) for path in [*MODULES, *SCRIPTS]}

# Imports point down only; rooms of one floor do not import each other.
FLOORS = (
    {"errors"},
    {"geometry"},
    {"records", "robot"},
    {"odometry", "command", "follow", "evaluate", "simulate"},
    {"estimation", "calibrate"},
    {"adapters"},
    {"apps"},
    {
        "donkeycar",
        "trundle",
        "__main__",
    },  # doors: a name to import by, the face itself, and `python -m trundle`
)
NOUNS = {"errors", "geometry", "records", "robot"}
# What some rooms may see of the floors below them, where that is less than everything.
BLINKERS = {"adapters": NOUNS, "follow": NOUNS - {"robot"}, "evaluate": NOUNS - {"robot"}}
# The rooms that may touch files, clocks, the environment and the screen.
EDGE = {"adapters", "apps", "donkeycar", "trundle", "__main__"}

# Rows of FAULTS.md that the issues closed so far have promised, and how many rows each of its chapters has.
FAULT_ROWS = {
    2: "C1 C2 C3 C4 C5 C6 C7 C8 C9 C10  S1 S2 S3 S4 S5 S6 S9 S10 S17 S18  L1 L7 L8 L9 L10 L11  X2 X3 X4",
    3: "K1 K2 K3 K4 K5 K6 K7 K8 K9 K10 K11 K13 K14 K15",
    4: "S7 S8 S11 S12 S13 S14 S16 S19 S20 S21 S26",
    5: "L2 L3 L4 L5 L6 L12 L13 L14 L15 L16 L17 L18 L19  D3 D5  X1 X5",
    6: "C12  S15  B1 B2 B3 B4 B5 B6 B7 B8",
    7: "C11  K12  R1 R2 R3 R4 R5 R6",
}
FAULT_CHAPTERS = {"C": 12, "S": 26, "L": 19, "K": 15, "B": 8, "W": 10, "R": 6, "D": 5, "X": 5}


# ------------------------------------------------------------------ reading source


def name_of(path: Path) -> str:
    """Dotted name of a module: src/trundle/robot/wheel.py is trundle.robot.wheel."""
    parts = path.relative_to(SOURCE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(module: str) -> str:
    """The room that a dotted name lies in: trundle.robot.wheel lies in robot."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


def dotted(node: ast.expr) -> str:
    """`os.environ.get` of the expression that says so; a part without a name is a question mark."""
    if isinstance(node, ast.Name):
        return node.id
    return f"{dotted(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else "?"


def imports_of(tree: ast.Module, module: str, *, is_package: bool) -> Iterator[tuple[ast.AST, str]]:
    """Each import of a module with its absolute dotted name.

    Imports inside functions and under TYPE_CHECKING count, and so does `import_module` of a written name.
    `from trundle import robot` is an import of trundle.robot.
    """
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node, alias.name
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*base, node.module] if node.module else base)
            if source == "trundle":
                for alias in node.names:
                    known = any(alias.name in rooms for rooms in FLOORS)
                    yield node, f"trundle.{alias.name}" if known else source
            else:
                yield node, source
        elif isinstance(node, ast.Call) and dotted(node.func).endswith("import_module") and node.args:
            yield node, ast.unparse(node.args[0]).strip("'\"")


def all_imports() -> Iterator[tuple[Path, ast.AST, str]]:
    for path in MODULES:
        for node, imported in imports_of(TREES[path], name_of(path), is_package=path.name == "__init__.py"):
            yield path, node, imported


def calls(paths: Iterable[Path]) -> Iterator[tuple[Path, ast.Call, str]]:
    for path in paths:
        for node in ast.walk(TREES[path]):
            if isinstance(node, ast.Call):
                yield path, node, dotted(node.func)


def complaint(path: Path, node: ast.AST, words: str) -> str:
    return f"{path.relative_to(CHECKOUT)}:{node.lineno}: {words}"


def none_of(complaints: Iterable[str]) -> None:
    complaints = sorted(complaints)
    assert not complaints, "\n" + "\n".join(complaints)


# --------------------------------------------------------------------- the layers


def may_import(room: str, other: str) -> bool:
    floor = {name: level for level, names in enumerate(FLOORS) for name in names}
    return room == other or (floor[other] < floor[room] and other in BLINKERS.get(room, floor))


def test_every_room_is_on_the_plan():
    rooms = {room_of(name_of(path)) for path in MODULES}
    assert rooms <= set().union(*FLOORS)


def test_imports_point_down():
    none_of(
        complaint(path, node, f"{room_of(name_of(path))} must not import {room_of(imported)} ({imported})")
        for path, node, imported in all_imports()
        if imported.split(".")[0] == "trundle" and not may_import(room_of(name_of(path)), room_of(imported))
    )


@pytest.mark.parametrize(
    ("room", "other"),
    [
        ("geometry", "robot"),
        ("robot", "records"),
        ("odometry", "command"),
        ("follow", "robot"),
        ("evaluate", "robot"),
        ("estimation", "calibrate"),
        ("adapters", "odometry"),
        ("adapters", "apps"),
        ("robot", "trundle"),
    ],
)
def test_layers_forbid(room, other):
    assert not may_import(room, other)


def test_every_form_of_import_is_seen():
    source = """
from typing import TYPE_CHECKING
from ..records import WheelLog
from trundle import robot, Pose2D
if TYPE_CHECKING:
    import trundle.odometry
def f():
    from trundle.apps import cli
    importlib.import_module("trundle.adapters")
"""
    found = {name for _, name in imports_of(ast.parse(source), "trundle.geometry.pose", is_package=False)}
    rooms = {"records", "robot", "odometry", "apps", "adapters"}
    assert found == {"typing", "trundle"} | {f"trundle.{room}" for room in rooms}


def test_files_are_named_for_what_they_hold():
    vague = {"util", "utils", "helper", "helpers", "manager", "managers", "common", "misc", "tools"}
    none_of(name_of(path) for path in MODULES if vague & set(re.split(r"[._]", name_of(path))))


# ----------------------------------------------------------------- purity and safety

OUTSIDE_MODULES = set(
    "asyncio builtins concurrent ctypes getpass glob http io logging mmap multiprocessing os platform queue "
    "random select shutil signal socket sqlite3 ssl subprocess sys tempfile threading time urllib".split()
)
OUTSIDE_CALLS = set("open print input breakpoint exit quit globals".split())
OUTSIDE_METHODS = set(
    "now utcnow today open read_text read_bytes write_text write_bytes mkdir unlink touch "
    "tofile fromfile loadtxt savetxt genfromtxt getLogger".split()
)


def test_inner_rooms_touch_nothing_outside():
    """Files, screen, clocks, environment, logs and globals are for adapters and apps: time is data."""
    inner = [path for path in MODULES if room_of(name_of(path)) not in EDGE]
    wrong = [
        complaint(path, node, f"imports {imported}")
        for path, node, imported in all_imports()
        if path in inner and imported.split(".")[0] in OUTSIDE_MODULES
    ]
    wrong += [
        complaint(path, node, f"calls {called}()")
        for path, node, called in calls(inner)
        if called in OUTSIDE_CALLS or ("." in called and called.split(".")[-1] in OUTSIDE_METHODS)
    ]
    wrong += [
        complaint(path, node, f"global {', '.join(node.names)}")
        for path in inner
        for node in ast.walk(TREES[path])
        if isinstance(node, ast.Global)
    ]
    none_of(wrong)


UNSAFE_MODULES = set("pickle _pickle cPickle dill cloudpickle joblib shelve marshal yaml".split())
UNSAFE_CALLS = set("eval exec compile os.system os.popen os.execv os.execvp yaml.load".split())


def unsafe_keywords(node: ast.Call, called: str) -> list[str]:
    given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    allowed = {"shell": ["False"], "allow_pickle": ["False"]}
    if called.endswith("YAML"):
        allowed["typ"] = ["'safe'", "'rt'"]
    wrong = [
        f"{name}={given[name]}" for name in allowed if name in given and given[name] not in allowed[name]
    ]
    if called in ("np.load", "numpy.load") and "allow_pickle" not in given:
        wrong.append("allow_pickle is not given")
    return wrong


def imported_by(path: Path) -> Iterator[tuple[ast.AST, str]]:
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node, node.module or ""


def test_nothing_runs_what_it_reads():
    """No pickle, eval, exec, shell or unsafe YAML in anything that we write."""
    wrong = [
        complaint(path, node, f"imports {imported}")
        for path in TREES
        for node, imported in imported_by(path)
        if imported.split(".")[0] in UNSAFE_MODULES
    ]
    for path, node, called in calls(TREES):
        wrong += [complaint(path, node, f"calls {called}()")] * (called in UNSAFE_CALLS)
        wrong += [complaint(path, node, f"{called}(... {words})") for words in unsafe_keywords(node, called)]
    none_of(wrong)


# ---------------------------------------------------------------------- dependencies

# The package that brings an import, where it goes by another name.
BRINGS = {
    "array_api_compat": "array-api-compat",
    "foxglove": "foxglove-sdk",
    "rerun": "rerun-sdk",
    "ruamel": "ruamel.yaml",
    "zlib_ng": "zlib-ng",
    "rclpy": "ros-rclpy",
    "geometry_msgs": "ros-geometry-msgs",
    "nav_msgs": "ros-nav-msgs",
    "sensor_msgs": "ros-sensor-msgs",
    "std_msgs": "ros-sensor-msgs",
    "std_srvs": "ros-std-srvs",
    "diagnostic_msgs": "ros-diagnostic-msgs",
}
# What only a sourced ROS installation brings.
SOURCED = {"tf2_msgs", "tf2_ros"}


def names_of(requirements: Iterable[str]) -> set[str]:
    return {re.match(r"[\w.-]+", requirement)[0] for requirement in requirements}


def test_packages_are_declared_and_optional_ones_imported_late():
    core = names_of(PROJECT["dependencies"])
    optional = names_of(itertools.chain(*PROJECT["optional-dependencies"].values())) - core
    not_ours = sys.stdlib_module_names | SOURCED | {"trundle"}
    wrong = []
    for path, node, imported in all_imports():
        package = imported.split(".")[0]
        distribution = BRINGS.get(package, package)
        if isinstance(node, ast.Call) or package in not_ours or distribution in core:
            continue
        if distribution not in optional:
            wrong.append(complaint(path, node, f"{imported} is no dependency or extra of pyproject.toml"))
        elif node in TREES[path].body:
            wrong.append(complaint(path, node, f"{imported} is optional: import it where it is needed"))
    none_of(wrong)


def test_extra_all_holds_every_extra_but_ros2():
    extras = PROJECT["optional-dependencies"]
    named = re.search(r"\[(.*)\]", extras["all"][0])[1].split(",")
    assert set(named) == set(extras) - {"all", "ros2"}


def packages_loaded_by(module: str) -> set[str]:
    """Packages other than Python's own that a new interpreter loads to import a module."""
    program = f"import sys; before = set(sys.modules); import {module}; print(*(set(sys.modules) - before))"
    listing = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    packages = {name.split(".")[0] for name in listing.stdout.split()}
    return packages - sys.stdlib_module_names - {"trundle"}


def test_importing_the_face_loads_nothing_else():
    assert packages_loaded_by("trundle") == set()


def test_command_line_loads_nothing_heavy_before_it_works():
    heavy = {"numpy", "scipy", "matplotlib", "pyarrow", "numba", "rosbags", "ruamel", "array_api_compat"}
    assert not packages_loaded_by("trundle.apps.cli") & heavy


# --------------------------------------------------------------------------- names


DOORS = {"__init__.py", "donkeycar.py"}  # they hand on what others define


def names_defined(path: Path) -> tuple[set[str], set[str]]:
    """Names that a module makes for others, and those (constants, aliases) that it may keep to itself."""
    made: set[str] = set()
    assigned: set[str] = set()
    body = list(TREES[path].body)
    for node in body:  # grows while it is read, so that blocks are entered
        match node:
            case ast.If() | ast.Try():
                body += [*node.body, *node.orelse]
            case ast.FunctionDef() | ast.ClassDef() | ast.AsyncFunctionDef():
                made.add(node.name)
            case ast.Assign():
                assigned |= {target.id for target in node.targets if isinstance(target, ast.Name)}
            case ast.AnnAssign(target=ast.Name(name)):
                assigned.add(name)
            case ast.ImportFrom() if path.name in DOORS and (node.module or "").startswith("trundle"):
                made |= {alias.asname or alias.name for alias in node.names}
    return {name for name in made if not name.startswith("_")}, assigned


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_all_is_what_the_module_exports(path):
    """Every public function and class, and every constant or alias that another module imports."""
    exported = list(getattr(importlib.import_module(name_of(path)), "__all__", []))
    made, assigned = names_defined(path)
    taken = {
        alias.name
        for other in MODULES
        for node in ast.walk(TREES[other])
        if isinstance(node, ast.ImportFrom) and node.module == name_of(path)
        for alias in node.names
    }
    assert sorted(exported) == sorted(set(exported))
    assert set(exported) == made | (assigned & taken) | (assigned & set(exported))


def test_face_gives_every_name_that_it_promises():
    assert [name for name in trundle.__all__ if not hasattr(trundle, name)] == []
    assert set(trundle.__all__) <= set(dir(trundle))
    assert not hasattr(trundle, "no_such_name")


# ---------------------------------------------------------------------- what is kept


def tracked_files() -> list[Path]:
    command = ["git", "ls-files", "-z"]
    listing = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    if listing.returncode:
        pytest.skip("this is not a git checkout")
    return [CHECKOUT / name for name in listing.stdout.split("\0") if (CHECKOUT / name).is_file()]


def test_no_lock_files_and_no_addresses_of_registries():
    """Packages are pinned by name and version; where they come from is the business of who installs them."""
    lock = re.compile(r".*\.lock|.*-lock\.(json|ya?ml)|pylock.*\.toml|go\.sum", re.IGNORECASE)
    hosts = "pypi|pythonhosted|npmjs|yarnpkg|anaconda|crates|debian|ubuntu|maven"
    address = re.compile(
        rf"://[a-z0-9.-]*({hosts})\.(org|com|io)|--hash[=]|index[-]url|find[-]links".encode()
    )
    none_of(
        [str(path.relative_to(CHECKOUT)) for path in tracked_files() if lock.fullmatch(path.name)]
        + [
            f"{path.relative_to(CHECKOUT)}: {found[0].decode()}"
            for path in tracked_files()
            if (found := address.search(path.read_bytes()))
        ]
    )


def test_no_recording_is_in_the_repository(shared_data):
    """Recordings belong to others. What ships is made by the simulator."""
    by_size: dict[int, list[Path]] = {}
    for path in shared_data.rglob("*.*"):
        by_size.setdefault(path.stat().st_size, []).append(path)

    def digest(path: Path) -> bytes:
        return hashlib.sha256(path.read_bytes()).digest()

    none_of(
        f"{path.relative_to(CHECKOUT)} is {twin.relative_to(shared_data)}"
        for path in tracked_files()
        for twin in by_size.get(path.stat().st_size, [])
        if path.stat().st_size and digest(path) == digest(twin)
    )


# ---------------------------------------------------------------------------- faults


@pytest.fixture(scope="module")
def fault_tests() -> set[str]:
    """Rows that a `test_fault[ROW]` or `test_fault[ROW-detail]` bears in its name."""
    command = [sys.executable, "-m", "pytest", "tests", "-k", "test_fault", "-m", "", "--collect-only", "-q"]
    listing = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert listing.returncode == 0, listing.stdout + listing.stderr
    names = re.findall(r"::test_fault\[(.+)\]", listing.stdout)
    return {word for name in names for word in name.split("-") if re.fullmatch(r"[A-Z]\d{1,2}", word)}


@pytest.mark.parametrize("issue", FAULT_ROWS)
def test_promised_faults_have_their_tests(issue, fault_tests):
    missing = set(FAULT_ROWS[issue].split()) - fault_tests
    assert not missing, f"FAULTS.md, issue {issue}: no test_fault[...] bears the name of {sorted(missing)}"


def test_fault_tests_bear_names_that_exist(fault_tests):
    assert {row for row in fault_tests if not 1 <= int(row[1:]) <= FAULT_CHAPTERS.get(row[0], 0)} == set()
