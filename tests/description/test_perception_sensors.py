"""Errors in the tags of cameras and lidars, and their messages."""

from pathlib import Path

import pytest

import arm_drake as ad
from arm_drake.errors import ArmDrakeError
from arm_drake.perception import scenery

_CAMERA = "<camera><image><width>32</width><height>24</height></image>{}</camera>"
_LIDAR = (
    "<lidar><scan><horizontal><samples>{samples}</samples><min_angle>{low}</min_angle>"
    "<max_angle>1</max_angle></horizontal></scan>"
    "<range><min>{near}</min><max>{far}</max></range></lidar>"
)
_NUMBERS = {"samples": "9", "low": "-1", "near": "0.1", "far": "9"}


def load(kind: str, inside: str, reference: str = "eye") -> ad.Robot:
    return ad.load_robot(
        f"""<robot name="r"><link name="world"/><link name="eye"/>
<joint name="a" type="fixed"><parent link="world"/><child link="eye"/></joint>
<gazebo reference="{reference}"><sensor name="front" type="{kind}">{inside}
</sensor></gazebo></robot>"""
    )


def lidar(**numbers: str) -> str:
    return _LIDAR.format(**{**_NUMBERS, **numbers})


@pytest.mark.parametrize(
    ("kind", "inside", "what"),
    [
        ("camera", "", "it has no <camera>"),
        ("gpu_lidar", "", "it has no <lidar> and no <ray>"),
        (
            "camera",
            _CAMERA.format("<clip><near>0</near></clip>"),
            "clip: expected 0 < near < far, got 0 and 100 m",
        ),
        (
            "camera",
            _CAMERA.format("<horizontal_fov>3.15</horizontal_fov>"),
            "horizontal_fov: expected more than 0 and less than pi, got 3.15 rad",
        ),
        (
            "camera",
            "<camera><image><height>0.5</height></image></camera>",
            "image height: expected 1 to 8192 pixels, got 0.5",
        ),
        (
            "camera",
            _CAMERA.format("<horizontal_fov>0</horizontal_fov>"),
            "horizontal_fov: expected more than 0 and less than pi, got 0 rad",
        ),
        (
            "camera",
            "<camera><image><width>8193</width></image></camera>",
            "image width: expected 1 to 8192 pixels, got 8193",
        ),
        (
            "camera",
            _CAMERA.format("<clip><near>5</near><far>5</far></clip>"),
            "clip: expected 0 < near < far, got 5 and 5 m",
        ),
        (
            "camera",
            "<camera><image><format>R8G8</format></image></camera>",
            "unknown pixel format 'R8G8'; known: R8G8B8, RGB_INT8, B8G8R8, BGR_INT8, "
            "L8, L_INT8, L16, L_INT16, R16G16B16, RGB_INT16, RGB_INT32, R_FLOAT16, "
            "R_FLOAT32, RGB_FLOAT16, RGB_FLOAT32, BAYER_RGGB8, BAYER_BGGR8, "
            "BAYER_GBRG8, BAYER_GRBG8, BAYER_RGGR8",
        ),
        (
            "gpu_lidar",
            lidar(samples="0"),
            "horizontal samples: expected 1 to 10000000, got 0",
        ),
        (
            "gpu_lidar",
            lidar(samples="nan"),
            "horizontal samples: expected 1 to 10000000, got nan",
        ),
        (
            "gpu_lidar",
            lidar(low="2"),
            "horizontal: expected min_angle <= max_angle, got 2 and 1 rad",
        ),
        (
            "gpu_lidar",
            lidar(near="9"),
            "range: expected 0 <= min < max, got 9 and 9 m",
        ),
    ],
)
def test_a_sensor_that_cannot_be_is_an_error(kind: str, inside: str, what: str) -> None:
    robot = load(kind, inside)

    about = [e for e in robot.report if "sensor" in e.what + e.where + e.done]
    assert [(e.severity, e.what, e.done) for e in about] == [
        ("error", what, "the sensor is left out")
    ]
    assert robot.description.perception_sensors == ()


def test_a_sensor_of_no_link_is_an_error() -> None:
    robot = load("camera", _CAMERA.format(""), reference="eve")

    [error] = [e for e in robot.report if "sensor" in e.what + e.where + e.done]
    assert error.what.startswith("its reference is no link, 'eve'; ")
    assert "eye" in error.what
    assert robot.description.perception_sensors == ()


@pytest.mark.parametrize(
    ("kind", "inside", "what"),
    [
        ("camera", "<gz_frame_id>eyes</gz_frame_id>" + _CAMERA.format(""),
         "its frame 'eyes' is no link; "),
        ("camera", _CAMERA.format("<optical_frame_id>ey</optical_frame_id>"),
         "its frame 'ey' is no link; "),
        ("camera", _CAMERA.format("<noise><type>salt</type></noise>"),
         "noise type: expected gaussian, gaussian_quantized or none, got 'salt'"),
        ("camera", "<update_rate>-1</update_rate>" + _CAMERA.format(""),
         "update_rate: expected at least 0, got '-1'"),
        ("camera", "<update_rate>inf</update_rate>" + _CAMERA.format(""),
         "update_rate: expected a finite number, got 'inf'"),
        ("gpu_lidar", "<update_rate>nan</update_rate>" + lidar(),
         "update_rate: expected a number, got 'nan'"),
        ("gpu_lidar", lidar(samples="10.5"),
         "horizontal samples: expected an integer, got 10.5"),
        ("camera", _CAMERA.format("<horizontal_fov>wide</horizontal_fov>"),
         "horizontal_fov: "),
        ("camera", _CAMERA.format("<distortion><k1>inf</k1></distortion>"),
         "k1: expected a finite number, got 'inf'"),
        ("camera", _CAMERA.format("<distortion><k1>0.1</k1><center>0.5 inf</center>"
                                  "</distortion>"),
         "distortion center: expected 2 numbers, got '0.5 inf'"),
        ("camera", _CAMERA.format("<lens><intrinsics><fx>300</fx><fy>300</fy>"
                                  "<cx>-20</cx><cy>100</cy></intrinsics></lens>"),
         "lens intrinsics: expected fx and fy more than 0, and cx and cy inside"),
        ("depth_camera", _CAMERA.format("<depth_camera><clip><near>5</near>"
                                        "<far>4</far></clip></depth_camera>"),
         "depths from 5 to 4 m"),
        ("camera", 2 * _CAMERA.format(""), "2 <camera> in one sensor"),
    ],
)  # fmt: skip
def test_what_is_taken_otherwise_is_a_warning(
    kind: str, inside: str, what: str
) -> None:
    robot = load(kind, inside)

    warnings = [e for e in robot.report if e.severity == "warning"]
    assert [e for e in warnings if e.what.startswith(what)]
    assert [s.name for s in robot.description.perception_sensors] == ["front"]


@pytest.mark.parametrize(
    ("kind", "inside", "told"),
    [
        (
            "camera",
            '<camera><save enabled="true"><path>x</path></save>'
            "<noise><stddev>0.1</stddev><bias_mean>1</bias_mean></noise>"
            "<triggered>true</triggered><pose>1 0 0 0 0 0</pose><zoom>2</zoom></camera>"
            "<enable_metrics>true</enable_metrics>",
            ["camera/save", "camera/noise/bias_mean", "camera/triggered", "camera/pose",
             "camera/zoom", "enable_metrics"],
        ),
        ("gpu_lidar", "<lidar><noise><bias_mean>1</bias_mean></noise></lidar>", []),
        ("ray", "<ray><visibility_mask>1</visibility_mask></ray><noise/>",
         ["ray/visibility_mask", "noise"]),
        ("multicamera", '<camera name="a"><pose>1 0 0 0 0 0</pose></camera>', []),
    ],
)  # fmt: skip
def test_each_tag_without_an_effect_is_reported(
    kind: str, inside: str, told: list[str]
) -> None:
    robot = load(kind, inside)

    assert [(e.what, e.done, e.where) for e in robot.report] == [
        (f"<{tag}>", "it has no effect", "sensor 'front'") for tag in told
    ]


def test_another_name_that_a_sensor_gets_is_reported() -> None:
    camera = _CAMERA.format("")
    again = f'</sensor><sensor name="front" type="camera">{camera}'
    robot = load("camera", camera + again + again)

    assert [s.name for s in robot.description.perception_sensors] == [
        *("front", "front_2", "front_3")
    ]
    assert [(e.severity, e.what, e.done, e.where) for e in robot.report] == [
        (
            "info",
            "another sensor is called 'front'",
            f"this one is {name!r}",
            "sensor 'front'",
        )
        for name in ("front_2", "front_3")
    ]


@pytest.mark.parametrize(
    ("topic", "taken"),
    [("a b//c", "/a_bc"), ("~/eye@2", "/eye2"), ("@", None), ("/eye/", "/eye")],
)
def test_a_topic_that_gazebo_does_not_take_becomes_one_that_it_does(
    topic: str, taken: str | None
) -> None:
    robot = load("gpu_lidar", f"<topic>{topic}</topic>" + lidar())
    simulation = ad.Simulation(ad.build_diagram(robot))

    usual = "/world/empty/model/r/link/eye/sensor/front/scan"
    assert simulation.lidar("front").topics["scan"] == (taken or usual)
    done = f"it is {taken[1:]!r}" if taken else "it is the usual one"
    told = f"topic {topic!r}: expected one without spaces, @, ~, // and :=; {done}"
    assert [str(e).partition("sensor 'front': ")[2] for e in simulation.report] == (
        [told] if taken != "/eye" else []
    )


@pytest.mark.parametrize(
    ("topic", "base"),
    [
        ("<topic>pair</topic>", "/pair"),
        ("", "/world/empty/model/r/link/eye/sensor/front"),
    ],
)
def test_cameras_of_a_multicamera_have_topics_of_their_own(
    topic: str, base: str
) -> None:
    camera = '<camera name="{}"><image><width>32</width><height>24</height></image>'
    both = "".join(camera.format(n) + "</camera>" for n in ("left", "right"))
    robot = load("multicamera", topic + both)

    simulation = ad.Simulation(ad.build_diagram(robot))

    assert [simulation.camera(f"front_{n}").topics for n in ("left", "right")] == [
        {key: f"{base}/{n}/{key}" for key in ("image", "camera_info")}
        for n in ("left", "right")
    ]
    assert list(simulation.report) == []


def test_a_missing_renderer_is_named_with_its_package(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(scenery, "_EGL", str(tmp_path / "libEGL.so.1"))
    monkeypatch.setattr(scenery.sys, "platform", "linux")
    scenery._egl.cache_clear()
    try:
        with pytest.raises(ArmDrakeError, match="apt-get install libegl1"):
            scenery.require_renderer()
    finally:
        scenery._egl.cache_clear()


@pytest.mark.parametrize(("kind", "lines"), [("depth_camera", 0), ("camera", 1)])
def test_depths_may_say_that_they_are_numbers(kind: str, lines: int) -> None:
    robot = load(kind, "<camera><image><format>R_FLOAT32</format></image></camera>")

    assert len(robot.report) == lines
