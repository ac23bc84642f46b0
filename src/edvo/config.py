"""Every parameter, once: its unit, its default, where it comes from, and the presets.

The defaults written here are the preset ``default``: the best values known by measurement over
all sequences at hand. The preset ``paper`` is the method as published; where the paper says
nothing, the choice and its reason stand here, and its measured worth in docs/theory.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from edvo.errors import ConfigError
from edvo.files import write_atomically
from edvo.plain_yaml import read_plain

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]

_FIXED = "a configuration does not change; make another, as by config.with_overrides(['seed=1'])"


class Section(BaseModel):
    """A group of parameters: no key that is not known, no change once made."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)

    if not TYPE_CHECKING:  # whom the fields tell what it takes

        def __init__(self, /, **values: object) -> None:
            try:
                super().__init__(**values)
            except ValidationError as error:
                raise ConfigError(_first_problem(error, type(self).__name__, type(self))) from error

        # By this pydantic tells that sections within sections need not be made by it.
        __init__.__pydantic_base_init__ = True

        def __setattr__(self, name: str, value: object) -> None:
            raise ConfigError(f"{name} = {_shown(value)}: {_FIXED}")

        def __delattr__(self, name: str) -> None:
            raise ConfigError(f"{name}: {_FIXED}")

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_values(cls, value: object) -> object:
        if isinstance(value, bool):  # YAML reads yes and on as such, and they would count as 1
            raise ValueError("neither true nor false is a value here")
        return value


class EdgesConfig(Section):
    """Edge extraction, §III-A."""

    extractor: Literal["canny", "sobel", "dog"] = Field(
        default="canny", description="which edges; the paper compares the three and takes Canny"
    )
    grey_steps: Literal[1, 2, 4, 8] = Field(
        default=8,
        description="a grey level of the blurred image is parted into so many steps, so that faint "
        "edges are not displaced by its rounding. Not in the paper",
    )
    blur_px: Annotated[int, Field(ge=0, le=31)] = Field(
        default=5, description="size of the Gaussian kernel before the gradient, odd; 0 for none"
    )
    max_noise: NotNegative = Field(
        default=2.5,
        description="grey levels (sigma): an image with more noise is blurred by more, until its "
        "gradients are as quiet as those of one with so much (with a blur_px of 5); 0 leaves "
        "images as they are. Not in the paper",
    )
    smear: Literal["none", "measured"] = Field(
        default="none",
        description="measured: images whose edges are smeared are blurred by more, as far as that "
        "shows from frame to frame (in Canny's edges, on a vertex), once motion.exposure tells "
        "that motion has smeared them; with motion.exposure=none whatever has. Not in the paper",
    )
    black_rim: Literal["ignored", "kept"] = Field(
        default="ignored",
        description="what is black about images, as outside the view of a lens, has edges that "
        "move with the camera: no edge is taken beside it. Not in the paper",
    )
    bands: Literal["removed", "kept"] = Field(
        default="removed",
        description="gradients that all pixels of a row share, as light that flickers makes them "
        "while the rows are read out, are taken off, or kept. Not in the paper",
    )
    carried: Literal["left-out", "kept"] = Field(
        default="left-out",
        description="edges that stay in the image while the view moves, as of dirt on the lens, or "
        "of print, are the camera's own: none is taken there. Not in the paper",
    )
    low: Positive = Field(
        default=20.0,
        description="Canny's lower threshold on ``|Sobel u| + |Sobel v|``; low ones matter where "
        "texture is missing: 20/40 against 50/100 halves the error on plain panels",
    )
    high: Positive = Field(default=40.0, description="Canny's upper threshold, same unit")
    strong_share: Fraction = Field(
        default=0.10,
        description="both of Canny's thresholds sink together, so that the upper one is exceeded "
        "by at least this share of the pixels: what is plain or dark shows its faint edges, and "
        "what is textured does not show its noise; 0 keeps them. Not in the paper",
    )
    least_scale: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.55,
        description="but by no more than to this fraction: below it noise begins in most images",
    )
    faint_scale: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.3,
        description="or to this one, where it is less, frames follow each other closely, and the "
        "noise of the image allows it: then edges are known again that are too faint to tell "
        "places by; 1: never. Not in the paper",
    )
    noise_margin: Positive = Field(
        default=8.0,
        description="for which the upper threshold has to be so many times the strength that a "
        "quarter of the gradients stay below",
    )
    max_blockiness: Positive = Field(
        default=1.8,
        description="and unless steps between blocks of 8 x 8 pixels are so many times as large as "
        "those amid them: then the image was compressed, and these are its faintest edges",
    )
    sobel_threshold: Positive = Field(
        default=120.0,
        description="extractor sobel: an edge where ``|Sobel u| + |Sobel v|`` exceeds this",
    )
    dog_sigma_px: Positive = Field(
        default=1.0,
        description="extractor dog: the narrower Gaussian; the wider is 1.6 times as wide",
    )
    dog_contrast: Positive = Field(
        default=3.0,
        description="extractor dog: least step of the difference across a zero crossing, grey",
    )
    position: Literal["vertex", "pixel"] = Field(
        default="vertex",
        description="where an edge lies: at the vertex of a Gaussian through three gradients, or "
        "in the middle of its pixel as in the paper",
    )
    depth_rule: Literal["sides", "window"] = Field(
        default="sides",
        description="depth of an edge: by planes through what lies to either side of it, as far as "
        "noise tells them apart, or from the window round it alone",
    )
    depth_window_px: Annotated[int, Field(ge=1, le=15)] = Field(
        default=5, description="side of the window that the depth of an edge is taken from, odd"
    )
    depth_gap: Positive = Field(
        default=0.05,
        description="relative depth step that separates two surfaces; the near one owns the edge",
    )
    strays: Literal["left-out", "kept"] = Field(
        default="left-out",
        description="depth that all pixels lie behind on a ring round it, a thirty-second of the "
        "image's width away, and that of the few edges that are far nearer than the rest: specks. "
        "No edge is drawn there, and nothing for max_conflict. Not in the paper",
    )

    @field_validator("blur_px", "depth_window_px")
    @classmethod
    def _odd(cls, value: int) -> int:
        if value and value % 2 == 0:
            raise ValueError("must be odd")
        return value


class SamplingConfig(Section):
    """Sub-sampling of the current edges, §IV-A."""

    count: Annotated[int, Field(ge=0)] = Field(
        default=1500,
        description="N; the paper finds 400 to 500 reasonable (Fig. 6), its preset takes 450; "
        "0 takes all edges",
    )
    max_growth: Annotated[float, Field(ge=1, allow_inf_nan=False)] = Field(
        default=3.0,
        description="so many times N are drawn where edges are sharp, and of those of late N share "
        "no more than what each errs by itself; 1: never more. Not in the paper",
    )
    cell_px: Annotated[int, Field(ge=1)] = Field(
        default=80, description="side of a grid cell; not in the paper. 48 cells at 640 x 480"
    )
    per_cell: Annotated[int, Field(ge=0)] = Field(
        default=5,
        description="edges drawn from each cell before the rest; 'at least five' in the paper",
    )
    selection: Literal["random", "informative"] = Field(
        default="random",
        description="which edges are drawn: at random, or one a cell, those that add most to what "
        "is known of the motion (log det of its information), as far as edges like them fitted of "
        "late; cell_px and per_cell are then left aside. Not in the paper",
    )
    tried: Annotated[int, Field(ge=1)] = Field(
        default=3, description="selection informative: edges of a cell that one is chosen from"
    )


class MatchingConfig(Section):
    """Edge matching, §III-B."""

    criterion: Literal["robust-then-normal", "robust", "normal"] = Field(
        default="robust-then-normal",
        description="Eq. (6) first and plain distance to finish (§V-B)",
    )
    gamma: Annotated[float, Field(ge=0)] = Field(
        default=0.7, description="weight of the gradient direction in Eq. (6)"
    )
    switch_px: Positive = Field(
        default=0.5,
        description="the normal criterion takes over once a step changes the residuals by less "
        "(rms); not in the paper",
    )
    max_distance_px: Positive = Field(
        default=30.0, description="a match further away is none; not in the paper"
    )
    max_angle_deg: Annotated[float, Field(gt=0, le=180)] = Field(
        default=180.0,
        description="a match whose gradient turns by more is none; 180 rejects nothing",
    )
    cell_px: Positive = Field(
        default=4.0, description="cell of the search grid; a matter of speed only"
    )


class RegistrationConfig(Section):
    """2-D edge divergence minimization, §III-C and §IV-B."""

    residual: Literal["divergence", "distance"] = Field(
        default="divergence",
        description="Eq. (12); or the unsigned Eq. (5) that the paper argues against",
    )
    weight: Literal["t", "huber", "cauchy", "tukey", "none"] = Field(
        default="tukey",
        description="robust weight function; the paper, and its preset, takes t (§IV-B)",
    )
    nu: Positive = Field(
        default=2.0, description="degrees of freedom of the t-distribution (§IV-B)"
    )
    min_sigma_px: Positive = Field(
        default=1e-3, description="floor of the scale, against an exact fit of a few residuals"
    )
    coarse_samples: Annotated[int, Field(ge=0)] = Field(
        default=375,
        description="where steps between frames are far, every k-th sample, and so many at least, "
        "is first matched by looking up some edge nearby that is turned alike; 0: none",
    )
    first_sigma_px: Annotated[float, Field(ge=0)] = Field(
        default=0.5,
        description="floor of the scale before the last stage, so that the many edges along a "
        "motion, which fit from the start, do not make outliers of the few across it",
    )
    own_scale_px: Annotated[float, Field(ge=0)] = Field(
        default=3.0,
        description="where hardly any of the edges count that could tell of a motion, since they "
        "scatter more than those along it, as what moves while it is exposed does, they count by a "
        "scale of their own, of so much at most; 0: never. With status.min_told and "
        "registration.profile_spread. Not in the paper",
    )
    first_samples: Annotated[int, Field(ge=0)] = Field(
        default=700,
        description="before the last stage every k-th sample is taken, and so many at least; "
        "0: all",
    )
    min_matches: Annotated[int, Field(ge=6)] = Field(
        default=30, description="fewer matches than this are no registration"
    )
    max_iterations: Annotated[int, Field(ge=1)] = Field(
        default=50, description="trial steps a frame; the paper sees 18.7 +- 5.4 (Fig. 9)"
    )
    stop_px: Positive = Field(
        default=0.03, description="converged once a step changes the residuals by less (rms)"
    )
    stop_share: Annotated[float, Field(ge=0)] = Field(
        default=0.05,
        description="in the last stage a step has to change the residuals by less than that share "
        "of their scale, too: where edges are sharp, what they hardly constrain is far from "
        "settled otherwise; 0: whatever their scale",
    )
    far_leave_px: Annotated[float, Field(ge=0)] = Field(
        default=0.08,
        description="where steps between frames are far, converged as soon as the steps of the "
        "iteration, as they shrink, leave less to go (rms), or that share of the residuals' scale "
        "where this is below a pixel; 0: not before",
    )
    stop_decrease: Annotated[float, Field(ge=0)] = Field(
        default=1e-4, description="converged once a step lowers the cost by less, relative"
    )
    damping: Positive = Field(
        default=1e-4, description="lambda of Eq. (14) at the start of each stage"
    )
    damping_up: Annotated[float, Field(gt=1)] = Field(
        default=10.0, description="on a rejected step"
    )
    damping_down: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.1, description="on an accepted one"
    )
    max_rejections: Annotated[int, Field(ge=0)] = Field(
        default=3, description="rejected steps in a row before a stage ends"
    )
    max_stretch: Annotated[float, Field(ge=1)] = Field(
        default=3.0,
        description="times its length that a step may be which goes on as the one before; 1: "
        "all are as Eq. (14) gives them",
    )
    profile_spread: NotNegative = Field(
        default=3.0,
        description="in the last stage an edge has half the weight if one of how strong and how "
        "wide it is has changed since the keyframe by so many times what is usual of edges of its "
        "direction: light has then moved it, too; 0: all count alike. Not in the paper",
    )
    kept_px: NotNegative = Field(
        default=0.25,
        description="in the last stage a step that changes the residuals by less (rms) leaves each "
        "point of depth on the plane that it has; 0: it is matched anew. Not in the paper",
    )


class PlanesConfig(Section):
    """The point-to-plane term on depth, beside the edges; not in the paper."""

    weight: Annotated[float, Field(ge=0)] = Field(
        default=1.0,
        description="of depth against edges, each in units of its own scale; 0 leaves it out",
    )
    edge_doubt_px: Annotated[float, Field(ge=0)] = Field(
        default=0.4,
        description="what edges err by together, at most, which their scatter does not show: depth "
        "counts as if they scattered by this much more",
    )
    edge_doubt_rule: Literal["measured", "fixed"] = Field(
        default="measured",
        description="by less where residuals of one cell of the image do not push the same way, "
        "frame after frame; or always by that much",
    )
    depth_doubt_rule: Literal["measured", "none"] = Field(
        default="measured",
        description="depth counts less where its residuals push the same way over cells of a "
        "quarter of the image's width, and edges do not; or whatever they do",
    )
    doubt: Positive = Field(
        default=1.5,
        description="depth counts half where its residuals are this large in units of the "
        "sensor's noise: beyond noise, errors are not independent from point to point",
    )
    sensor: Literal["kinect_v1", "realsense_d435", "realsense_d415", "azure_kinect"] = Field(
        default="kinect_v1", description="whose noise sigma_z(z) the residuals are measured in"
    )
    map_step_px: Annotated[int, Field(ge=1)] = Field(
        default=8, description="a keyframe has a plane at every such pixel"
    )
    point_step_px: Annotated[int, Field(ge=1)] = Field(
        default=16, description="a frame has a point at every such pixel"
    )
    reach_px: Annotated[int, Field(ge=1)] = Field(
        default=8, description="half the window that a plane is fitted to"
    )
    stride_px: Annotated[int, Field(ge=1)] = Field(
        default=4, description="every such pixel of the window is looked at"
    )
    finer: Literal["measured", "none"] = Field(
        default="measured",
        description="points, and the pixels that are looked at, half as far apart where depth "
        "errs at each point by itself, frame after frame; or never",
    )
    flatness: Positive = Field(
        default=2.5,
        description="a window whose depth is off the plane by more than so many times the noise "
        "(rms) shows no plane",
    )
    max_angle_deg: Annotated[float, Field(gt=0, le=180)] = Field(
        default=37.0, description="a point whose normal turns by more has no plane"
    )
    max_distance: Positive = Field(
        default=30.0, description="nor has one farther from it than so many times the noise"
    )
    min_points: Annotated[int, Field(ge=6)] = Field(
        default=50, description="with fewer points the term is left out"
    )
    alone_share: Fraction = Field(
        default=0.5,
        description="a frame without edges goes on by depth alone, degraded, where this share of "
        "its points lies on planes of the keyframe; 0: it is lost",
    )
    alone_keyframes: Literal["made", "none"] = Field(
        default="made",
        description="such a frame is the next keyframe where fewer than three quarters of its "
        "points lie on planes of the last one, and depth leaves no motion open: so the camera is "
        "followed for as long as darkness lasts. Or it is lost once alone_share is undercut. With "
        "alone_share. Not in the paper",
    )
    lead: Literal["changed-views", "none"] = Field(
        default="changed-views",
        description="where the edges of a view have changed at once, as those of light that jumps, "
        "depth alone leads on, if it leaves no motion open, and the frame is degraded; or it is "
        "lost. With alone_share. Not in the paper",
    )
    contours: Literal["followed", "none"] = Field(
        default="followed",
        description="along motions that neither edges nor planes constrain, a pose is moved to "
        "where the contours of depth fit those of the keyframe, as in darkness, or where white "
        "things stand before white walls. It stays degraded. With planes.weight, and of frames "
        "with edges with status.covariance. Not in the paper",
    )
    outvoted: Literal["asked", "left"] = Field(
        default="asked",
        description="where depth is good, off by less than 0.6 times its noise as a rule, edges "
        "scatter by more than 0.25 px or fewer than eight tenths of them agree, and of a hundred "
        "points four more than of late are outliers, a frame that is no far step is registered "
        "once more from where all of depth leads. What 3 % more points fit, by no more than 1.1 "
        "times the scale, is taken, if depth leaves no motion open and four fifths as many edges "
        "agree, and is not left for what fits less of depth. Or outliers are left alone. Not in "
        "the paper",
    )


class KeyframesConfig(Section):
    """The keyframe method, §V-C."""

    rule: Literal["motion", "gap"] = Field(
        default="motion", description="by motion and overlap, or every so many frames (Fig. 10)"
    )
    gap_frames: Annotated[int, Field(ge=1)] = Field(
        default=10, description="rule gap: frames a keyframe"
    )
    max_translation_m: Positive = Field(
        default=0.15,
        description="rule motion: from the keyframe; what views differ by errs more with each "
        "centimetre, each new keyframe with all that the one before it erred by",
    )
    far_translation_m: Positive = Field(
        default=0.3,
        description="rule motion: the same where that is more, for a frame that does not follow "
        "the last one within 0.2 s, or of which only what stands still was registered: its place "
        "is not as sure. Not in the paper",
    )
    max_rotation_deg: Positive = Field(default=15.0, description="rule motion: from the keyframe")
    early_share: Fraction = Field(
        default=1.0,
        description="rule motion: past this share of the two bounds a frame is taken already if "
        "its covariance (status.covariance) is smaller than the mean of the last half second; 1: "
        "not before the bounds. Not in the paper",
    )
    tells_times: Annotated[float, Field(ge=0)] = Field(
        default=4.0,
        description="rule motion: where a motion is not constrained, a frame becomes the keyframe "
        "at once whose own edges tell so many times more of it (1 or more), being out of the last "
        "one's view; 0: not, and the one left is not come back to. With status.covariance and "
        "status.min_told. Not in the paper",
    )
    window: Annotated[int, Field(ge=1)] = Field(
        default=5,
        description="a new keyframe is registered with one before the last, too, where that is "
        "near, and the poses of so many keyframes are solved for together; 1 or 2: it is placed by "
        "the last one alone. With status.covariance. Not in the paper",
    )
    stored: Annotated[int, Field(ge=0)] = Field(
        default=30,
        description="keyframes kept to find back to after a loss, the present one included; about "
        "a megabyte each. 0 keeps none. Not in the paper",
    )
    tried: Annotated[int, Field(ge=1)] = Field(
        default=3, description="of those, how many a lost frame is registered with: the likest"
    )
    earlier: Annotated[int, Field(ge=0)] = Field(
        default=4,
        description="where a frame fits the keyframe too little to be trusted, as where light goes "
        "to and fro, so many of the nearest of those kept are tried in its place; 0: none, and "
        "one that was left along what nothing told (tells_times) is not come back to. Needs "
        "planes.weight. Not in the paper",
    )
    min_overlap: Fraction = Field(
        default=0.75, description="rule motion: least share of the samples that fit the keyframe"
    )
    gather_share: Fraction = Field(
        default=0.33,
        description="rule motion: where fewer fit within this share of the two bounds on motion, "
        "light has changed, and the keyframe gathers the edges that it does not know in place of "
        "giving way; 0: never. Not in the paper",
    )
    edge_scale: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.7,
        description="Canny's thresholds for the faintest edges of a keyframe, where they follow "
        "the image, times the lowest for a frame that shows what it does, so that it knows what "
        "other light shows more clearly; 1: the same. Not in the paper",
    )

    @field_validator("tells_times")
    @classmethod
    def _is_more(cls, times: float) -> float:
        if 0 < times < 1:
            raise ValueError("give 0, or 1 and more")
        return times


class MotionConfig(Section):
    """What is known of the motion before the images are looked at."""

    prior: Literal["constant-velocity", "still"] = Field(
        default="constant-velocity",
        description="where registration starts; constant velocity is checked against standing "
        "still and the better of the two taken",
    )
    prior_stride: Annotated[int, Field(ge=1)] = Field(
        default=8, description="the check looks at one sample in so many"
    )
    depth_delay: Literal["measured", "stamps", "none"] = Field(
        default="measured",
        description="from the instant of a colour image to that of its depth, for what the camera "
        "moves by in between to be made up for: as stamps tell it, and what is measured beyond "
        "them while tracking; as stamps tell it; or taken to be none. With planes.weight. Not in "
        "the paper",
    )
    depth_slack: Literal["measured", "none"] = Field(
        default="measured",
        description="depth that was not taken at the instant of its image may lie elsewhere than "
        "the camera's velocity puts it, all of it as one, by as much as that has changed of late: "
        "it then says how far things are, and edges how the camera is turned; or it lies where the "
        "velocity puts it. With motion.depth_delay. Not in the paper",
    )
    row_slack: Literal["measured", "none"] = Field(
        default="measured",
        description="rows that were not taken at the instant of their image may lie elsewhere than "
        "the camera's velocity puts them, by as much as that has changed of late: how it changes "
        "within the image is solved for together with the pose, and keyframes are put right by it; "
        "or they lie where the velocity puts them. With motion.readout. Not in the paper",
    )
    repeated_depth: Literal["recognised", "new"] = Field(
        default="recognised",
        description="depth that is to the bit that of the frame before, as from a camera that "
        "takes fewer depth images than colour images: recognised, so that it is taken to be of the "
        "instant of that one, and to say nothing of what has happened since; or taken for new. "
        "What it shows is moved where depth_delay is not none, with planes.weight. Not in the "
        "paper",
    )
    readout: Literal["measured", "known", "none"] = Field(
        default="measured",
        description="from the first row of an image to the last, for what the camera moves by in "
        "between to be made up for: measured while tracking, what readout_s says, or taken to be "
        "none. Not in the paper",
    )
    readout_s: Annotated[float, Field(ge=-0.033, le=0.033)] = Field(
        default=0.0,
        validate_default=True,
        description="readout known: how long that takes, seconds, negative where rows are read "
        "from below; summary.json of another recording by the camera tells. Not in the paper",
    )
    exposure: Literal["measured", "known", "none"] = Field(
        default="measured",
        description="for how long an image is exposed, so that edges which moved meanwhile count "
        "less, as they were smeared, and edges.smear knows smeared ones from soft ones: measured "
        "while tracking, what exposure_s says, or taken to be an instant. With "
        "registration.profile_spread. Not in the paper",
    )
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = Field(
        default=0.0,
        validate_default=True,
        description="exposure known: how long that is, seconds; summary.json of another recording "
        "in the same light tells. Not in the paper",
    )
    search_deg: Annotated[float, Field(ge=0, le=45)] = Field(
        default=24.0,
        description="where a registration is in doubt, or a step is a far one, turns of the camera "
        "up to so much to either side, and half as much up and down, 3 degrees apart, are judged "
        "at a glance, and the likeliest registered; 0 for none. Not in the paper",
    )
    aside_px: Annotated[float, Field(ge=0, le=20)] = Field(
        default=4.0,
        description="where a registration is in doubt, or a fifth fewer edges agree than before, "
        "and less than eight tenths do: it is tried from so many pixels to each side of where the "
        "frame is expected, and kept if edges are clearly more in their places; 0 does not. Needs "
        "search_deg and planes.weight. Not in the paper",
    )
    along_px: Annotated[float, Field(ge=0, le=200)] = Field(
        default=40.0,
        description="where less than half of the edges that could tell a motion are in their "
        "places: these are looked for so far along it to either side, 2 px apart, and the frame "
        "registered from where they fall clearly better; 0 does not look. With status.min_told. "
        "Not in the paper",
    )
    inertia: Literal["loose", "none"] = Field(
        default="loose",
        description="where a registration is less sure than 10 mm or 0.4 degrees: it is weighed "
        "along each motion against where the camera was going, or stands as it is. With "
        "status.covariance. Not in the paper",
    )
    max_speed_m_s: Positive = Field(default=5.0, description="a faster pose is an error")
    max_turn_deg_s: Positive = Field(default=500.0, description="a faster turn is an error")

    @field_validator("readout_s", "exposure_s")
    @classmethod
    def _goes_with_the_rule(cls, seconds: float, others: ValidationInfo) -> float:
        key = str(others.field_name)
        rule = key.removesuffix("_s")
        if (others.data.get(rule) == "known") != (seconds != 0):
            raise ValueError(f"{rule}: known and {key}, not 0, go together; give both")
        return seconds


class StatusConfig(Section):
    """When a pose is not to be trusted."""

    inlier_px: Positive = Field(
        default=2.0, description="a match with a smaller residual is an inlier"
    )
    min_inliers: Fraction = Field(
        default=0.5,
        description="share of the samples that are inliers, below which the frame is lost (but see "
        "edge_jump)",
    )
    doubt_inliers: Fraction = Field(
        default=0.65, description="share below which a tracked frame is called degraded"
    )
    min_agreeing: Fraction = Field(
        default=0.4,
        description="share of the samples that are inliers and whose gradient is that of their "
        "match, to 45 degrees, below which the frame is lost: where edges are dense, those of "
        "another place fit too, but a quarter at most agrees. Not in the paper",
    )
    doubt_agreeing: Fraction = Field(
        default=0.5, description="share below which a tracked frame is called degraded"
    )
    first_agreeing: Fraction = Field(
        default=0.7,
        description="that share in the second after the first frame, where frames follow closely "
        "and edges scatter by more than half a pixel, or depth is off the keyframe's planes "
        "by more than 1.5 times its noise, below which it is degraded; and what follows a keyframe "
        "made of such a frame, or of one whose edges scatter by more than 0.75 px, depth being "
        "off: how well both fit as a rule is not known yet, and whoever walks by may fill the "
        "view. Where seven tenths agree, and depth is off by more than max_depth_sigma and "
        "leads elsewhere than edges, something moves (with max_conflict). 0 asks none of it. Not "
        "in the paper",
    )
    edge_jump: NotNegative = Field(
        default=2.5,
        description="a frame whose edges scatter about their matches by so many times what they "
        "did of late, while depth lies on the keyframe's planes as ever, is registered anew by the "
        "scale of late, as is one that is lost; and one that is followed closely is degraded, not "
        "lost, if that share (min_agreeing) of its edges still are in their places. What leaps is "
        "lost, too; or, in doubt, degraded for a second if it leaps by more than 5 cm. 0 leaves "
        "all of that. Not in the paper",
    )
    min_told: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.25,
        description="share of what edges could tell of a motion that has to count: where all but "
        "those that run along it are left out as wrong matches, the frame is registered anew by a "
        "wider scale, and if that does not help the motion counts as not constrained. 0 does not "
        "ask. Not in the paper",
    )
    depth_jump: Positive = Field(
        default=3.0,
        description="a frame whose depth is off the planes of the keyframe by so many times the "
        "most that it was of late is registered once more from where depth leads, and degraded if "
        "that is off as well. Not in the paper",
    )
    max_depth_sigma: Positive = Field(
        default=5.0,
        description="a degraded frame whose depth is off the planes of the keyframe by more than "
        "so many times the sensor's noise is lost: edges and depth contradict each other; and such "
        "depth does not tell what stands still",
    )
    max_conflict: Fraction = Field(
        default=0.02,
        description="share of the view that stands where a moment ago nothing was, above which "
        "something moves by itself and a frame is degraded, for a second more, unless all that "
        "moves was left out (moving_m) and the rest stands still; 0 does not ask. Not in the paper",
    )
    lost_conflict: Fraction = Field(
        default=0.3, description="share of that above which a frame is lost; with max_conflict"
    )
    moving: Literal["leave-out", "follow"] = Field(
        default="leave-out",
        description="what moves by itself, once max_conflict has noticed that something does: it "
        "is left out where depth tells it from what stands still, or edges and depth count all "
        "alike. Not in the paper",
    )
    moving_m: Annotated[float, Field(ge=0, le=5)] = Field(
        default=0.35,
        description="edges and depth within so many metres of what has come, within half a second, "
        "to where nothing was are left out for a while, though too little moves for max_conflict "
        "to notice; 0 keeps them. With max_conflict and moving. Not in the paper",
    )
    sudden_change: Literal["doubt", "ignore"] = Field(
        default="doubt",
        description="where a frame is in doubt for its fit with a keyframe of less than 0.1 s ago, "
        "as a hand before the lens makes it, what follows within a second is degraded, or not. Not "
        "in the paper",
    )
    lost: Literal["begin-anew", "wait"] = Field(
        default="begin-anew",
        description="a camera that is lost for more than a second, but whose images fit one "
        "another: it begins anew where it was expected, degraded until it sees again what it saw "
        "before, or waits for that; with keyframes.stored. Not in the paper",
    )
    torn: Literal["doubt", "ignore"] = Field(
        default="doubt",
        description="a frame whose edges scatter by 1.6 times what they did of late, and whose "
        "depth is off the planes by twice what it was, is registered once more from where depth "
        "leads; if depth then is off by four times that, or 1.5 times the noise, it is degraded, "
        "with what follows within a second, once ten frames have told what is usual. Or neither. "
        "Not in the paper",
    )
    unshared: Literal["excused", "counted"] = Field(
        default="excused",
        description="edges that only one of frame and keyframe has in view, where a frame that "
        "follows closely would be lost for how few of its edges fit: it is degraded if, of those "
        "that both have in view, six tenths fit, one way times the other, and the keyframe "
        "registered with it leads back; or they count, and it is lost. Not in the paper",
    )
    leaps: Literal["asked", "lost"] = Field(
        default="asked",
        description="a frame that follows closely, and is farther from where it was expected than "
        "a hand moves a camera (edge_jump): it is degraded if, of what it and its keyframe have in "
        "view, eight tenths fit, one way times the other, nothing beside it fits as well, and no "
        "motion is left open, or if it only leaps along what nothing constrains (with "
        "motion.inertia); or it is lost. Needs motion.search_deg. Not in the paper",
    )
    just_lost: Literal["by-faint-edges", "as-any"] = Field(
        default="by-faint-edges",
        description="a frame that is lost, as one to three just before it were, of the last 0.2 s: "
        "registered once more with all edges of its keyframe, faint ones (edges.faint_scale), too, "
        "and kept if eight tenths of its own agree; or lost as any other. Not in the paper",
    )
    covariance: Literal["instants", "cells", "none"] = Field(
        default="instants",
        description="how far a pose may be off, and which motions nothing constrains, which "
        "degrades the frame; with what is not known of the instants at which rows and depth were "
        "taken, or without, by which poses go in either case. Not in the paper",
    )


class Config(Section):
    """Everything the odometry can be told.

    What is left out is that of the preset, of a section given by its keys, too; one that is given
    as an object counts whole.

    Examples
    --------
    >>> Config.preset("paper").sampling.count
    450
    >>> Config().with_overrides(["sampling.count=900", "keyframes.rule=gap"]).sampling.count
    900
    """

    preset_name: Literal["default", "paper"] = Field(
        default="default", description="the preset that this was made from"
    )
    seed: Annotated[int, Field(ge=0, lt=2**31)] = Field(
        default=0, description="of the sub-sampling"
    )
    edges: EdgesConfig = EdgesConfig()
    sampling: SamplingConfig = SamplingConfig()
    matching: MatchingConfig = MatchingConfig()
    registration: RegistrationConfig = RegistrationConfig()
    planes: PlanesConfig = PlanesConfig()
    keyframes: KeyframesConfig = KeyframesConfig()
    motion: MotionConfig = MotionConfig()
    status: StatusConfig = StatusConfig()

    @model_validator(mode="before")
    @classmethod
    def _what_is_left_out_is_the_presets(cls, values: object) -> object:
        if not isinstance(values, Mapping):
            return values
        name = values.get("preset_name")
        return _merged(PRESETS.get(name, {}) if isinstance(name, str) else {}, values)

    @model_validator(mode="after")
    def _thresholds_rise(self) -> "Config":
        low, high = self.edges.low, self.edges.high
        if low > high:  # as OpenCV does, Canny would take the one for the other
            raise ValueError(f"edges.low = {low:g} is above edges.high = {high:g}; set both")
        return self

    @classmethod
    def preset(cls, name: str) -> "Config":
        """Make the configuration of a preset.

        Parameters
        ----------
        name : str
            ``default`` or ``paper``.

        Returns
        -------
        Config

        Raises
        ------
        ConfigError
            If there is no such preset.
        """
        if name not in PRESETS:
            raise ConfigError(f"no preset {name!r}; there are {', '.join(PRESETS)}")
        return cls.from_dict({"preset_name": name})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], *, where: str = "configuration") -> "Config":
        """Make a configuration from nested keys; what they leave out is the preset's.

        Parameters
        ----------
        values : mapping
            As ``to_dict`` gives them; any part may be missing.
        where : str
            What to call them in an error.

        Returns
        -------
        Config

        Raises
        ------
        ConfigError
            Naming the first key that is unknown or out of range; or if these are no keys.
        """
        if not isinstance(values, Mapping):
            raise ConfigError(f"{where}: expected keys such as 'sampling:', got {values!r:.60}")
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise ConfigError(_first_problem(error, where, cls)) from error

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Config":
        """Read a YAML file such as ``to_yaml`` writes.

        Parameters
        ----------
        path : path-like

        Returns
        -------
        Config

        Raises
        ------
        ConfigError
            If the file cannot be read, is no YAML mapping, or has a bad key or value.
        """
        try:
            values = read_plain(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            reason = " ".join(str(error).split())
            raise ConfigError(f"{path} is no YAML: {reason}") from error
        return cls.from_dict({} if values is None else values, where=str(path))

    def with_overrides(self, assignments: Iterable[str]) -> "Config":
        """Copy with some keys set, as on the command line.

        Parameters
        ----------
        assignments : iterable of str
            Each ``a.b=value``; the value is read as YAML.

        Returns
        -------
        Config

        Raises
        ------
        ConfigError
            If they are no list, one is no assignment, or its key or value is refused.
        """
        # A str is a list, too, of its letters.
        if isinstance(assignments, str) or not isinstance(assignments, Iterable):
            raise ConfigError(
                f"overrides are {_shown(assignments)}; give a list, as ['sampling.count=900']"
            )
        values = self.to_dict()
        for assignment in assignments:
            if not isinstance(assignment, str):
                raise ConfigError(
                    f"{_shown(assignment)} is no KEY=VALUE, such as 'sampling.count=900'"
                )
            key, equals, text = assignment.partition("=")
            if not equals or not key.strip():
                raise ConfigError(f"{assignment!r} is no KEY=VALUE, such as sampling.count=900")
            try:
                value = read_plain(text)
            except yaml.YAMLError as error:
                raise ConfigError(f"{key}: cannot read the value {text!r}") from error
            if key.strip() == "preset_name":
                raise ConfigError("preset_name cannot be set: choose a preset (--preset) instead")
            node = values
            *parents, leaf = key.strip().split(".")
            for parent in parents:
                child = node.get(parent)
                if not isinstance(child, dict):
                    raise ConfigError(f"unknown key {key.strip()!r}; {_known(key.strip(), Config)}")
                node = child
            node[leaf] = value
        return self.from_dict(values, where="override")

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, every key."""
        return self.model_dump()

    def to_yaml(self, path: str | os.PathLike[str]) -> None:
        """Write every key to a YAML file.

        Parameters
        ----------
        path : path-like

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_atomically(path, yaml.safe_dump(self.to_dict(), sort_keys=False))


PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "paper": {
        "edges": {
            "strong_share": 0.0,
            "faint_scale": 1.0,
            "position": "pixel",
            "grey_steps": 1,
            "max_noise": 0.0,
            "black_rim": "kept",
            "bands": "kept",
            "carried": "kept",
            "strays": "kept",
            "depth_rule": "window",
        },
        "planes": {
            "weight": 0.0,
            "alone_share": 0.0,
            "alone_keyframes": "none",
            "lead": "none",
            "contours": "none",
            "outvoted": "left",
            "edge_doubt_rule": "fixed",
            "depth_doubt_rule": "none",
            "finer": "none",
        },
        "motion": {
            "search_deg": 0.0,
            "aside_px": 0.0,
            "along_px": 0.0,
            "prior_stride": 4,
            "depth_delay": "none",
            "depth_slack": "none",
            "row_slack": "none",
            "repeated_depth": "new",
            "readout": "none",
            "exposure": "none",
            "inertia": "none",
        },
        "keyframes": {
            "max_translation_m": 0.3,
            "tells_times": 0.0,
            "window": 1,
            "stored": 0,
            "earlier": 0,
            "gather_share": 0.0,
            "edge_scale": 1.0,
        },
        "sampling": {"count": 450, "max_growth": 1.0},
        "registration": {
            "weight": "t",
            "coarse_samples": 0,
            "stop_share": 0.0,
            "far_leave_px": 0.0,
            "first_sigma_px": 0.0,
            "own_scale_px": 0.0,
            "first_samples": 0,
            "max_stretch": 1.0,
            "kept_px": 0.0,
            "profile_spread": 0.0,
        },
        "status": {
            "max_conflict": 0.0,
            "min_agreeing": 0.0,
            "doubt_agreeing": 0.0,
            "first_agreeing": 0.0,
            "covariance": "none",
            "moving": "follow",
            "moving_m": 0.0,
            "lost": "wait",
            "sudden_change": "ignore",
            "torn": "ignore",
            "unshared": "counted",
            "leaps": "lost",
            "just_lost": "as-any",
            "edge_jump": 0.0,
            "min_told": 0.0,
        },
    },
}


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in over.items():
        below = result.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            result[key] = _merged(below, value)
        else:
            result[key] = value
    return result


def _first_problem(error: ValidationError, where: str, model: type[BaseModel]) -> str:
    """Say in a line what is wrong with values for a section."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return f"{where}: unknown key {key!r}; {_known(key, model)}"
    message = first["msg"].removeprefix("Value error, ")
    if not key:  # of several, which the message names
        return f"{where}: {message}"
    return f"{where}: {key} = {_shown(first['input'])}: {message}"


def _shown(value: object) -> str:
    """Show a value in a line."""
    return f"{' '.join(repr(value).split()):.60}"


def _known(key: str, model: type[BaseModel]) -> str:
    """Name the keys that stand beside an unknown one of a section."""
    for part in key.split(".")[:-1]:
        field = model.model_fields.get(part)
        if field is None or not isinstance(field.annotation, type):
            break
        if not issubclass(field.annotation, BaseModel):
            break
        model = field.annotation
    return f"known here: {', '.join(model.model_fields)}"
