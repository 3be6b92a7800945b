"""Tiers by region: what the recipe asks for, what was measured, and what is done about it."""

from dataclasses import replace

import numpy as np
import pytest
from analytic import BALL, scene

from rpaug.compose import views
from rpaug.operators.camera_pose import CameraPose
from rpaug.operators.light_color import LightColor
from rpaug.pipeline import plan, recipe, residuals
from rpaug.pipeline.prepare import build_and_plan, planned
from rpaug.pipeline.recipe import Accuracy
from rpaug.pipeline.residuals import BACKGROUND, Residual

EYES = {"front": (1.6, 0.3, 1.0), "overhead": (0.1, -0.9, 1.5)}
REGIONS = {BACKGROUND: frozenset({0, 1}), "body 7": frozenset({7})}
FACTS = {"per_camera_db": {"front": 31.0}, "depth_error_mm": 4.0, "train_db": 30.0, "steps": 9}


@pytest.fixture(scope="module")
def episode():
    return scene(EYES, length=2).episode


@pytest.fixture
def made(episode):
    return plan.make([CameraPose(camera="front")], episode)


def measured(background: float, body: float, pixels: int = 900) -> list[Residual]:
    return [
        Residual("front", BACKGROUND, background, 0.1, 9000),
        Residual("front", "body 7", body, 0.2, pixels),
    ]


def by_name(planned: plan.Plan) -> dict[str, plan.Region]:
    return {region.name: region for region in planned.regions if region.camera == "front"}


def test_without_an_accuracy_the_table_is_quoted_and_nothing_rises(made) -> None:
    assert [str(region.error) for region in made.regions] == ["27.6 dB, 0.00 mm (table)"] * 2
    assert not made.gaussians


def test_what_is_good_enough_stays(made) -> None:
    found = plan.weigh(made, REGIONS, measured(28, 27), Accuracy(psnr=25))
    assert {region.tier for region in found.regions} == {1}
    assert all(region.met for region in found.regions)


def test_only_the_region_that_misses_rises_and_says_why(made) -> None:
    found = plan.weigh(made, REGIONS, measured(28, 20), Accuracy(psnr=25))
    body = by_name(found)["body 7"]
    assert (body.tier, body.lower.psnr, body.met) == (3, 20, True)
    assert by_name(found)[BACKGROUND].tier == 1
    assert found.representations["front"] == 1
    assert found.blended == {"front": frozenset({7})}
    assert found.gaussians
    assert "since the tier below gives 20.0 dB" in str(body)


def test_a_camera_all_of_whose_regions_rise_is_drawn_by_gaussians(made) -> None:
    found = plan.weigh(made, REGIONS, measured(20, 20), Accuracy(psnr=25))
    assert found.representations["front"] == 3
    assert found.blended == {}


def test_nothing_rises_to_a_tier_that_is_not_expected_to_do(made) -> None:
    found = plan.weigh(made, REGIONS, measured(28, 20), Accuracy(psnr=35))
    assert {region.tier for region in found.regions} == {1}
    assert by_name(found)["body 7"].met is False
    assert "misses" in str(by_name(found)["body 7"])


def test_a_handful_of_pixels_is_no_measurement(made) -> None:
    found = plan.weigh(made, REGIONS, measured(28, 20, pixels=30), Accuracy(psnr=25))
    assert by_name(found)["body 7"].tier == 1
    assert by_name(found)["body 7"].error.known == "table"


def test_recorded_pixels_meet_any_accuracy(episode) -> None:
    flat = plan.make([LightColor()], episode)
    found = plan.weigh(flat, REGIONS, [], Accuracy(psnr=90, depth_mm=0.001))
    assert all(region.met and region.tier == 0 for region in found.regions)


def test_after_the_fit_a_region_goes_back_where_gaussians_are_no_better(made) -> None:
    risen = plan.weigh(made, REGIONS, measured(20, 20), Accuracy(psnr=25))
    after = plan.fitted(risen, FACTS, measured(31, 18))
    assert (by_name(after)[BACKGROUND].tier, by_name(after)[BACKGROUND].error.known) == (3, "fit")
    back = by_name(after)["body 7"]
    assert (back.tier, back.error.psnr, back.met) == (1, 20, False)
    assert after.blended == {"front": REGIONS[BACKGROUND]}
    assert after.describe()["fit"]["train_db"] == 30


def test_a_copy_whose_camera_stays_is_recorded_pixels(made, episode) -> None:
    risen = plan.weigh(made, REGIONS, measured(20, 20), Accuracy(psnr=25))
    settled = plan.settle(risen, scene(EYES, length=2))
    assert settled.representations["front"] == 0
    assert not settled.gaussians


def test_a_plan_is_plain_values(made) -> None:
    described = plan.weigh(made, REGIONS, measured(28, 20), Accuracy(psnr=25)).describe()
    body = described["regions"][1]
    assert body["risen_from"] == {"psnr": 20, "depth_mm": 0.2, "known": "measured"}
    assert body["met"] is True


def test_there_and_back_is_measured_where_a_camera_goes_and_by_region() -> None:
    known = scene(EYES, length=2)
    camera = known.cameras["front"]
    shift = np.eye(4)
    shift[0, 3] = 0.05
    moved = replace(camera, cam_to_world=camera.cam_to_world @ shift)
    found = residuals.measure(known, {"front": moved})
    assert {one.camera for one in found} == {"front"}
    assert all(20 < one.psnr < 100 for one in found if one.region == BACKGROUND)
    assert all(one.depth_mm < 1 for one in found if one.region == BACKGROUND)
    still = residuals.measure(known, {"front": camera})
    assert all(one.psnr == 100 for one in still)  # a camera that goes nowhere misses nothing


def test_a_recipe_with_an_accuracy_has_its_errors_measured(episode) -> None:
    asked = recipe.build(
        {
            "version": 1,
            "accuracy": {"psnr": 15},
            "edits": [{"op": "camera_pose", "camera": "front"}],
        }
    )
    found = planned(episode, asked, 0)
    assert by_name(found)[BACKGROUND].error.known == "measured"
    assert (
        found.regions == build_and_plan(episode, asked, 0)[1].regions
    )  # the same whenever it is asked


def test_gaussians_show_a_region_in_a_view_of_surfels(monkeypatch: pytest.MonkeyPatch) -> None:
    known = scene(EYES, length=2)
    rgb, depth, ids = (
        getattr(known.episode.views["front"], name)(0) for name in ("rgb", "depth", "ids")
    )
    monkeypatch.setattr(
        views,
        "_gaussians",
        lambda *given: views.Frame(255 - rgb, depth + 1, ids, np.zeros(ids.shape, bool)),
    )
    shown = views.edited(
        known, {"front": 1, "overhead": 0}, lambda *given: None, {"front": frozenset({BALL})}
    ).views["front"]
    ball = ids == BALL
    assert ball.any()
    assert (shown.rgb(0)[ball] == 255 - rgb[ball]).all()
    assert (shown.rgb(0)[~ball] == rgb[~ball]).all()
    np.testing.assert_allclose(shown.depth(0)[ball], depth[ball] + 1)
    np.testing.assert_array_equal(shown.depth(0)[~ball], depth[~ball])
