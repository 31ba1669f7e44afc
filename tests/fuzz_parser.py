"""Fuzz one parser: `python tests/fuzz_parser.py PARSER SECONDS`.

By atheris, which looks for inputs that reach new lines, where it is installed (`pip install atheris`: 130 MB,
so not among the tests' own packages); else by chance.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import pkgutil
import random
import sys
import tempfile
import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

try:
    import atheris
except ImportError:
    atheris = None


def parsers():
    """The module with the parsers and their seeds, loaded so that atheris sees which lines run."""
    watched = atheris.instrument_imports(include=["trundle"]) if atheris else contextlib.nullcontext()
    with watched:
        import trundle.adapters

        for module in pkgutil.iter_modules(trundle.adapters.__path__):
            importlib.import_module(f"trundle.adapters.{module.name}")
        spec = spec_from_file_location("parsers", Path(__file__).with_name("test_log_fuzz.py"))
        assert spec is not None
        assert spec.loader is not None
        found = module_from_spec(spec)
        sys.modules["parsers"] = found
        spec.loader.exec_module(found)
    return found


def main(name: str, seconds: int) -> None:
    known = parsers()
    folder = Path(tempfile.mkdtemp(prefix="trundle-fuzz-"))
    target, seed = known.Target(name, folder), known.seed_of(name)
    atexit.register(
        lambda: print(f"{name}, {seconds} s by {'atheris' if atheris else 'chance'}: {target}", flush=True)
    )
    if atheris is None:
        end = time.monotonic() + seconds
        for content in known.mutations(seed, random.Random(name)):
            if time.monotonic() > end:
                return
            target(content)
    corpus = folder / "corpus"
    corpus.mkdir()
    (corpus / "seed").write_bytes(seed)
    limits = [
        f"-max_total_time={seconds}",
        "-max_len=65536",
        "-rss_limit_mb=2048",
        f"-artifact_prefix={folder}/",
    ]
    atheris.Setup([sys.argv[0], str(corpus), *limits], target)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
