import numpy as np
import pytest

from edvo.errors import SceneError
from edvo.synthesis.light import DirectionalLight, LightSignal, LightState, PointLight
from edvo.synthesis.scene_lights import SCENE_LIGHTS, scene_light

LAMPS = LightState(
    0.4,
    (DirectionalLight((0.3, 0.8, -0.5), 0.2), DirectionalLight((-0.9, 0.3, -0.3), 0.1)),
    (PointLight((0.0, -1.0, 2.5), 1.1),),
)


@pytest.mark.parametrize("name", [*SCENE_LIGHTS, "ambient+diffuse"])
def test_no_severity_leaves_the_lamps_alone(name: str) -> None:
    light = scene_light(name, LAMPS, severity=0.0)
    assert isinstance(light, LightSignal)
    for t in (0.0, 0.3, 2.7):
        state = light.at(t)
        assert state.ambient == pytest.approx(LAMPS.ambient)
        for lamp, own in zip(state.directional, LAMPS.directional, strict=True):
            assert lamp.direction == pytest.approx(own.direction)
            assert lamp.intensity == pytest.approx(own.intensity)
        assert state.point[0].position == pytest.approx(LAMPS.point[0].position)


def test_ambient_scales_all_lamps_alike() -> None:
    light = scene_light("ambient", LAMPS, severity=1.0, frequency=0.5, jumps=())
    state = light.at(1.5)
    factor = 2.0**-2.5
    assert state.ambient == pytest.approx(0.4 * factor)
    assert state.directional[1].intensity == pytest.approx(0.1 * factor)
    assert state.point[0].intensity == pytest.approx(1.1 * factor)


def test_diffuse_moves_the_lamps_out_of_step_and_keeps_their_height() -> None:
    light = scene_light("diffuse", LAMPS, severity=1.0, frequency=1.0)
    state = light.at(0.25)
    assert state.ambient == LAMPS.ambient
    ratios = [
        lamp.intensity / own.intensity
        for lamp, own in zip(
            (*state.directional, *state.point), (*LAMPS.directional, *LAMPS.point), strict=True
        )
    ]
    assert ratios[0] == pytest.approx(2**1.5)
    assert max(ratios) / min(ratios) > 3
    direction = np.array(state.directional[0].direction)
    assert np.linalg.norm(direction) == pytest.approx(np.linalg.norm((0.3, 0.8, -0.5)))
    assert direction[2] == -0.5
    turn = np.arctan2(direction[1], direction[0]) - np.arctan2(0.8, 0.3)
    assert np.degrees(turn) == pytest.approx(35.0)


def test_jumps_come_where_they_are_asked_for() -> None:
    light = scene_light("exposure", LAMPS, severity=1.0, jumps=(1.0,))
    assert light.at(0.999).ambient == pytest.approx(0.4)
    assert abs(np.log2(light.at(1.0).ambient / 0.4)) >= 1.2


def test_wrong_names_and_numbers_are_refused() -> None:
    with pytest.raises(SceneError, match="unknown light 'disco'; there are: constant, ambient"):
        scene_light("ambient+disco", LAMPS)
    with pytest.raises(SceneError, match="severity is -1"):
        scene_light("ambient", LAMPS, severity=-1)
    with pytest.raises(SceneError, match="frequency is 0"):
        scene_light("ambient", LAMPS, frequency=0)
