"""The end of a bridge that is a ROS 2 node: runs in the user's own Python, which has rclpy and nothing of ours.

Therefore it imports nothing but the standard library and rclpy, and keeps to what Python 3.10 and Humble's rclpy have.
"""
