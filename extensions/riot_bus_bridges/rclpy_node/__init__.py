"""The ROS 2 node of a bridge: runs in the user's own Python, which has rclpy but none of our packages.

Therefore it imports only the standard library and rclpy, and uses only features of Python 3.10 and Humble's rclpy.
"""
