"""RealSense's plugin for Gazebo Classic: its sensors by name, its topics and depths."""

import numpy as np
import pytest

import arm_drake as ad
from arm_drake.messages import CameraInfo, Image, PointCloud2
from arm_drake.perception.images import to_array, to_colors, to_points

_TAGS = """<prefix>eye_</prefix><colorUpdateRate>60</colorUpdateRate>
<depthTopicName>aligned_depth/image_raw</depthTopicName>
<depthCameraInfoTopicName>aligned_depth/camera_info</depthCameraInfoTopicName>
<colorTopicName>color/image_raw</colorTopicName>
<infrared1TopicName>infra1/image_raw</infrared1TopicName>
<infrared2TopicName>infra2/image_raw</infrared2TopicName>
<colorOpticalframeName>color_optical</colorOpticalframeName>
<depthOpticalframeName>depth_optical</depthOpticalframeName>
<infrared1OpticalframeName>depth_optical</infrared1OpticalframeName>
<infrared2OpticalframeName>depth_optical</infrared2OpticalframeName>
<rangeMinDepth>0.3</rangeMinDepth><rangeMaxDepth>1.5</rangeMaxDepth>
<pointCloud>true</pointCloud><pointCloudTopicName>depth/color/points</pointCloudTopicName>
<pointCloudCutoff>0.5</pointCloudCutoff>"""

_ENDS = ("color", "depth", "ired1", "ired2")


def sensor(end: str) -> str:
    kind = "depth" if end == "depth" else "camera"
    pixels = "L_INT8" if end.startswith("ired") else "RGB_INT8"
    return f"""<sensor name="eye_{end}" type="{kind}"><update_rate>30</update_rate>
<camera><horizontal_fov>1.0</horizontal_fov><image><width>160</width>
<height>120</height><format>{pixels}</format></image><clip><near>0.05</near>
<far>100</far></clip><noise><type>gaussian</type><stddev>{0.1 * (kind == "depth")}
</stddev></noise></camera></sensor>"""


def load(tags: str = _TAGS, ends: tuple[str, ...] = _ENDS) -> ad.Robot:
    """Return a camera before a wall at 1.2346 m, a box at 0.4 m, and one at 2 m."""
    boxes = [
        # Left, nearer than points are told; right, farther than depths are told.
        ("0.405 0.12 0", "0.01 0.1 0.6", "0.9 0.1 0.1 1"),
        ("2.005 -0.6 0", "0.01 0.5 0.6", "0.1 0.1 0.9 1"),
        ("1.2396 0 0", "0.01 0.3 0.6", "0.1 0.9 0.1 1"),
    ]
    seen = "".join(
        f'<visual><origin xyz="{xyz}"/><geometry><box size="{size}"/></geometry>'
        f'<material name="m{index}"><color rgba="{color}"/></material></visual>'
        for index, (xyz, size, color) in enumerate(boxes)
    )
    return ad.load_robot(
        f"""<robot name="r"><link name="world"/><link name="eye">{seen}</link>
<joint name="a" type="fixed"><parent link="world"/><child link="eye"/>
<origin xyz="0 0 1"/></joint>{"".join(optical(n) for n in ("color", "depth"))}
<gazebo reference="eye">{"".join(map(sensor, ends))}</gazebo>
<gazebo><plugin name="any" filename="librealsense_gazebo_plugin.so">{tags}</plugin>
</gazebo></robot>"""
    )


def optical(name: str) -> str:
    return (
        f'<link name="{name}_optical"/><joint name="{name}" type="fixed">'
        f'<parent link="eye"/><child link="{name}_optical"/>'
        '<origin rpy="-1.5708 0 -1.5708"/></joint>'
    )


@pytest.fixture(scope="module")
def simulation() -> ad.Simulation:
    return ad.Simulation(ad.build_diagram(load()))


@pytest.mark.parametrize(
    ("text", "has_points"), [("True", True), ("1", True), ("False", False), ("", False)]
)
def test_it_tells_points_where_its_tag_says_true(text: str, has_points: bool) -> None:
    tags = _TAGS.replace("<pointCloud>true", f"<pointCloud>{text}")

    [depth] = load(tags, ("depth",)).description.perception_sensors

    assert ("points" in dict(depth.plugin_topics)) == has_points


def test_its_topics_are_those_of_its_tags(simulation: ad.Simulation) -> None:
    [robot] = simulation.robots.values()
    sensors = robot.description.perception_sensors
    topics = {
        row.name: row.type for row in simulation.list_topics() if "/eye_/" in row.name
    }

    assert {s.name for s in sensors} == {f"eye_{end}" for end in _ENDS}
    assert topics == {
        "/eye_/color/image_raw": "Image",
        "/eye_/color/camera_info": "CameraInfo",
        "/eye_/aligned_depth/image_raw": "Image",
        "/eye_/aligned_depth/camera_info": "CameraInfo",
        "/eye_/depth/color/points": "PointCloud2",
        "/eye_/infra1/image_raw": "Image",
        "/eye_/infra1/camera_info": "CameraInfo",
        "/eye_/infra2/image_raw": "Image",
        "/eye_/infra2/camera_info": "CameraInfo",
    }


@pytest.mark.slow
def test_its_depths_are_whole_millimetres_in_its_range(
    simulation: ad.Simulation,
) -> None:
    image = simulation.topic("/eye_/aligned_depth/image_raw").value()
    depths = to_array(image)

    assert isinstance(image, Image)
    assert (image.encoding, image.header.frame_id) == ("16UC1", "depth_optical")
    assert depths[60, 80] == 1234
    # The box on the left is told, that on the right is beyond 1.5 m.
    assert depths[60, 40] in (399, 400)
    assert depths[60, 120] == 0
    exact = simulation.camera("eye_depth").depth()
    # In Classic depths have no noise.
    assert exact[60, 80] == pytest.approx(1.2346, abs=1e-4)
    assert exact[60, 120] == pytest.approx(2.0, abs=1e-3)


def test_its_points_are_between_its_cutoffs(simulation: ad.Simulation) -> None:
    cloud = simulation.topic("/eye_/depth/color/points").value()
    points, colors = to_points(cloud), to_colors(cloud)

    assert isinstance(cloud, PointCloud2)
    assert cloud.header.frame_id == "depth_optical"
    focal = 160 / (2.0 * np.tan(0.5))
    expected = 1.2346 * np.array([(80 - 79.5) / focal, (60 - 59.5) / focal, 1.0])
    np.testing.assert_allclose(points[60, 80], expected, atol=1e-4)
    # 0.4 m is nearer than the cutoff; 2 m is before the usual one, of 5 m.
    assert np.isnan(points[60, 40]).all()
    assert points[60, 120, 2] == pytest.approx(2.0, abs=1e-3)
    assert colors is not None
    assert colors[60, 80].argmax() == 1
    assert colors[60, 120].argmax() == 2


def test_its_pictures_have_frames_and_encodings_of_their_own(
    simulation: ad.Simulation,
) -> None:
    color = simulation.topic("/eye_/color/image_raw").value()
    infrared = simulation.topic("/eye_/infra2/image_raw").value()
    info = simulation.topic("/eye_/infra2/camera_info").value()

    assert (color.encoding, color.header.frame_id) == ("rgb8", "color_optical")
    assert (infrared.encoding, infrared.step) == ("8UC1", 160)
    assert to_array(infrared).shape == (120, 160)
    assert isinstance(info, CameraInfo)
    assert info.k[0] == pytest.approx(160 / (2.0 * np.tan(0.5)))


@pytest.mark.parametrize(
    ("tags", "ends", "told"),
    [
        (
            _TAGS + "<depthTopic>d</depthTopic>",
            _ENDS,
            "<depthTopic>; did you mean 'depthTopicName'",
        ),
        (_TAGS, _ENDS[:2], "no sensor 'eye_ired1', <prefix> and 'ired1'; "),
        (
            _TAGS.replace("aligned_depth/camera_info", "depth/camera_info"),
            _ENDS,
            "depthCameraInfoTopicName 'depth/camera_info'",
        ),
        (
            _TAGS.replace(">1.5<", ">0.2<"),
            _ENDS,
            "rangeMinDepth: expected less than rangeMaxDepth, 0.2 m, got '0.3 m'",
        ),
        (
            _TAGS.replace("aligned_depth/image_raw", ""),
            _ENDS,
            "depthTopicName: expected a topic for depth_image, got ''",
        ),
        (
            _TAGS.replace(">color_optical<", ">colour_optical<"),
            _ENDS,
            "its frame 'colour_optical' is no link; did you mean 'color_optical'",
        ),
    ],
)
def test_what_is_wrong_is_reported(tags: str, ends: tuple[str, ...], told: str) -> None:
    report = load(tags, ends).report

    assert [entry for entry in report if entry.what.startswith(told)]


def test_a_right_one_has_one_line_about_the_noise() -> None:
    lines = [entry.what for entry in load().report if entry.kind == "ignored"]

    assert [x for x in lines if "realsense" in x] == []
    assert "noise of a depth camera of Gazebo Classic" in lines
