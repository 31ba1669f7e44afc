"""`trundle ros2`: odometry and safe wheel commands of a described robot, as a ROS 2 node.

What decides stands in `base` and knows no ROS; `node` gives it clocks, topics and parameters.
"""
