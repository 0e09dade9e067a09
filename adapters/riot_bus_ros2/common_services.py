"""Services and actions of packages that every ROS 2 installation has: fields only, without constants and comments.

rosbags' stores hold the messages of these packages, but no services.
"""

from __future__ import annotations

SERVICES = {
    "action_msgs/srv/CancelGoal": "GoalInfo goal_info\n---\nint8 return_code\nGoalInfo[] goals_canceling\n",
    "composition_interfaces/srv/ListNodes": "---\nstring[] full_node_names\nuint64[] unique_ids\n",
    "composition_interfaces/srv/LoadNode": (
        "string package_name\nstring plugin_name\nstring node_name\nstring node_namespace\nuint8 log_level\n"
        "string[] remap_rules\nrcl_interfaces/Parameter[] parameters\nrcl_interfaces/Parameter[] extra_arguments\n"
        "---\nbool success\nstring error_message\nstring full_node_name\nuint64 unique_id\n"
    ),
    "composition_interfaces/srv/UnloadNode": "uint64 unique_id\n---\nbool success\nstring error_message\n",
    "diagnostic_msgs/srv/AddDiagnostics": "string load_namespace\n---\nbool success\nstring message\n",
    "diagnostic_msgs/srv/SelfTest": "---\nstring id\nbyte passed\nDiagnosticStatus[] status\n",
    "example_interfaces/srv/AddTwoInts": "int64 a\nint64 b\n---\nint64 sum\n",
    "example_interfaces/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "example_interfaces/srv/Trigger": "---\nbool success\nstring message\n",
    "lifecycle_msgs/srv/ChangeState": "Transition transition\n---\nbool success\n",
    "lifecycle_msgs/srv/GetAvailableStates": "---\nState[] available_states\n",
    "lifecycle_msgs/srv/GetAvailableTransitions": "---\nTransitionDescription[] available_transitions\n",
    "lifecycle_msgs/srv/GetState": "---\nState current_state\n",
    "nav_msgs/srv/GetMap": "---\nnav_msgs/OccupancyGrid map\n",
    "nav_msgs/srv/GetPlan": (
        "geometry_msgs/PoseStamped start\ngeometry_msgs/PoseStamped goal\nfloat32 tolerance\n---\nnav_msgs/Path plan\n"
    ),
    "nav_msgs/srv/LoadMap": "string map_url\n---\nnav_msgs/OccupancyGrid map\nuint8 result\n",
    "nav_msgs/srv/SetMap": (
        "nav_msgs/OccupancyGrid map\ngeometry_msgs/PoseWithCovarianceStamped initial_pose\n---\nbool success\n"
    ),
    "rcl_interfaces/srv/DescribeParameters": "string[] names\n---\nParameterDescriptor[] descriptors\n",
    "rcl_interfaces/srv/GetLoggerLevels": "string[] names\n---\nLoggerLevel[] levels\n",
    "rcl_interfaces/srv/GetParameterTypes": "string[] names\n---\nuint8[] types\n",
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nParameterValue[] values\n",
    "rcl_interfaces/srv/ListParameters": "string[] prefixes\nuint64 depth\n---\nListParametersResult result\n",
    "rcl_interfaces/srv/SetLoggerLevels": "LoggerLevel[] levels\n---\nSetLoggerLevelsResult[] results\n",
    "rcl_interfaces/srv/SetParameters": "Parameter[] parameters\n---\nSetParametersResult[] results\n",
    "rcl_interfaces/srv/SetParametersAtomically": "Parameter[] parameters\n---\nSetParametersResult result\n",
    "sensor_msgs/srv/SetCameraInfo": ("sensor_msgs/CameraInfo camera_info\n---\nbool success\nstring status_message\n"),
    "std_srvs/srv/Empty": "---\n",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
    "tf2_msgs/srv/FrameGraph": "---\nstring frame_yaml\n",
    "type_description_interfaces/srv/GetTypeDescription": (
        "string type_name\nstring type_hash\nbool include_type_sources\n---\nbool successful\nstring failure_reason\n"
        "TypeDescription type_description\nTypeSource[] type_sources\nKeyValue[] extra_information\n"
    ),
    "visualization_msgs/srv/GetInteractiveMarkers": "---\nuint64 sequence_number\nInteractiveMarker[] markers\n",
}

ACTIONS = {
    "example_interfaces/action/Fibonacci": "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n",
    "tf2_msgs/action/LookupTransform": (
        "string target_frame\nstring source_frame\nbuiltin_interfaces/Time source_time\n"
        "builtin_interfaces/Duration timeout\nbuiltin_interfaces/Time target_time\nstring fixed_frame\nbool advanced\n"
        "---\ngeometry_msgs/TransformStamped transform\nTF2Error error\n---\n"
    ),
}
