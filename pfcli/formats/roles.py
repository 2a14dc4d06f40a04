"""Which role in a run a message type can play, and in which order equal stamps count."""

from pfcli.events import (
    Heading,
    Landmarks,
    LinePoints,
    Odometry,
    Range,
    Scan,
    SourceStamp,
    Steering,
    Ticks,
    Truth,
    Twist,
    Wheels,
    YawRate,
)

ROLES: dict[str, dict[str, type]] = {
    "odometry": {
        "nav_msgs/msg/Odometry": Odometry,
        "pfcli.Odometry": Odometry,
        "geometry_msgs/msg/PoseWithCovarianceStamped": Odometry,
        "geometry_msgs/msg/PoseStamped": Odometry,
    },
    "encoders": {"sensor_msgs/msg/JointState": Wheels, "pfcli.WheelEncoders": Ticks},
    "twist": {
        "geometry_msgs/msg/TwistStamped": Twist,
        "geometry_msgs/msg/TwistWithCovarianceStamped": Twist,
        "geometry_msgs/msg/Twist": Twist,
        "ackermann_msgs/msg/AckermannDriveStamped": Steering,
        "pfcli.Twist": Twist,
        "pfcli.Ackermann": Steering,
    },
    "imu": {"sensor_msgs/msg/Imu": YawRate},
    "compass": {
        "pfcli.Heading": Heading,
        "sensor_msgs/msg/MagneticField": Heading,
        "sensor_msgs/msg/Imu": Heading,
    },
    "scan": {
        "sensor_msgs/msg/LaserScan": Scan,
        "pfcli.LaserScan": Scan,
        "sensor_msgs/msg/MultiEchoLaserScan": Scan,
        "sensor_msgs/msg/PointCloud2": Scan,
    },
    "range": {"sensor_msgs/msg/Range": Range, "pfcli.Range": Range},
    "lines": {
        "pfcli.LinePoints": LinePoints,
        "soccer_vision_3d_msgs/msg/MarkingArray": LinePoints,
    },
    "landmarks": {
        "pfcli.Landmarks": Landmarks,
        "vision_msgs/msg/Detection3DArray": Landmarks,
        "vision_msgs/msg/Detection2DArray": Landmarks,
        "soccer_vision_3d_msgs/msg/GoalpostArray": Landmarks,
        "soccer_vision_3d_msgs/msg/MarkingArray": Landmarks,
    },
    "truth": {
        "geometry_msgs/msg/PoseStamped": Truth,
        "pfcli.Pose2D": Truth,
        "nav_msgs/msg/Odometry": Truth,
        "geometry_msgs/msg/PoseWithCovarianceStamped": Truth,
        "sensor_msgs/msg/NavSatFix": Truth,
    },
    "source_stamp": {"std_msgs/msg/String": SourceStamp},
}
"""Role in a run -> message type -> event kind."""

MANY = ("range", "landmarks", "scan")
"""Roles that several topics may play together; several scanners where they are named."""

RANK = {role: rank for rank, role in enumerate(ROLES)}
RANK.update(source_stamp=-1, scan=20, range=21, lines=22, landmarks=23, truth=-2)
"""Order of events with equal stamps: truth and source stamp first, motion next, what depends on motion last."""
