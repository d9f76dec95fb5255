"""Definitions of common ROS 2 messages (`common_interfaces`), for bags that hold none."""

SEPARATOR = "=" * 80
TIME = """MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
HEADER = f"""MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
{TIME}"""
DEFINITIONS = {
    "sensor_msgs/msg/JointState": f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{SEPARATOR}
{HEADER}""",
    "geometry_msgs/msg/WrenchStamped": f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{SEPARATOR}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{SEPARATOR}
{HEADER}""",
    "std_msgs/msg/Float64": "float64 data\n",
    "std_msgs/msg/Float32": "float32 data\n",
    "std_msgs/msg/Float64MultiArray": f"""std_msgs/MultiArrayLayout layout
float64[] data
{SEPARATOR}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{SEPARATOR}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
""",
}
