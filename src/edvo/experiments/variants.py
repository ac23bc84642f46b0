"""The method with one part changed at a time, so that each part's worth can be measured."""

from dataclasses import dataclass

from edvo.config import Config


@dataclass(frozen=True, slots=True)
class Variant:
    """A change of one part.

    Attributes
    ----------
    name : str
        The part and what it becomes.
    changes : tuple of str
        Assignments for `edvo.config.Config.with_overrides`.
    """

    name: str
    changes: tuple[str, ...]


VARIANTS = (
    Variant("edges: Sobel threshold", ("edges.extractor=sobel",)),
    Variant("edges: difference of Gaussians", ("edges.extractor=dog",)),
    Variant("edges: Canny 30/60", ("edges.low=30", "edges.high=60")),
    Variant("edges: Canny 50/100", ("edges.low=50", "edges.high=100")),
    Variant("edges: no blur", ("edges.blur_px=0",)),
    Variant("edges: of a blur in whole grey levels", ("edges.grey_steps=1",)),
    Variant("edges: of a blur in eighths of grey levels", ("edges.grey_steps=8",)),
    Variant("edges: fixed thresholds", ("edges.strong_share=0",)),
    Variant("edges: thresholds that follow the image", ("edges.strong_share=0.1",)),
    Variant("edges: none fainter where noise allows", ("edges.faint_scale=1",)),
    Variant(
        "edges: fainter where noise allows", ("edges.strong_share=0.1", "edges.faint_scale=0.3")
    ),
    Variant("images: noisy ones as they are", ("edges.max_noise=0",)),
    Variant("images: noisy ones blurred by more", ("edges.max_noise=2.5",)),
    Variant("images: compressed ones as they are", ("edges.max_blockiness=1e9",)),
    Variant("images: smeared ones blurred by more", ("edges.smear=measured",)),
    Variant("images: black rims kept", ("edges.black_rim=kept",)),
    Variant("images: black rims ignored", ("edges.black_rim=ignored",)),
    Variant("images: what the camera carries kept", ("edges.carried=kept",)),
    Variant("images: what the camera carries left out", ("edges.carried=left-out",)),
    Variant("images: bands of a lamp kept", ("edges.bands=kept",)),
    Variant("images: bands of a lamp removed", ("edges.bands=removed",)),
    Variant("edges: at whole pixels", ("edges.position=pixel",)),
    Variant("edges: between pixels", ("edges.position=vertex",)),
    Variant("planes: none", ("planes.weight=0",)),
    Variant("planes: beside the edges", ("planes.weight=1",)),
    Variant(
        "planes: edges doubted by 0.4 px always",
        ("planes.weight=1", "planes.edge_doubt_rule=fixed"),
    ),
    Variant(
        "planes: at that whatever depth errs by together",
        ("planes.weight=1", "planes.depth_doubt_rule=none"),
    ),
    Variant("planes: never finer", ("planes.weight=1", "planes.finer=none")),
    Variant("planes: do not lead", ("planes.weight=1", "planes.lead=none")),
    Variant(
        "planes: lead where a view has changed",
        ("planes.weight=1", "planes.alone_share=0.5", "planes.lead=changed-views"),
    ),
    Variant(
        "planes: no keyframes of depth alone", ("planes.weight=1", "planes.alone_keyframes=none")
    ),
    Variant(
        "planes: keyframes of depth alone",
        ("planes.weight=1", "planes.alone_share=0.5", "planes.alone_keyframes=made"),
    ),
    Variant("planes: contours not followed", ("planes.weight=1", "planes.contours=none")),
    Variant(
        "planes: contours followed",
        ("planes.weight=1", "planes.alone_share=0.5", "planes.contours=followed"),
    ),
    Variant("planes: outvoted ones left", ("planes.weight=1", "planes.outvoted=left")),
    Variant("planes: outvoted ones asked", ("planes.weight=1", "planes.outvoted=asked")),
    Variant("planes: edges not doubted", ("planes.weight=1", "planes.edge_doubt_px=0")),
    Variant(
        "planes: at full weight whatever the residuals", ("planes.weight=1", "planes.doubt=1e6")
    ),
    Variant("planes: at a fixed weight of 0.3", ("planes.weight=0.3", "planes.doubt=1e6")),
    Variant("depth: by planes to either side", ("edges.depth_rule=sides",)),
    Variant("depth: 5 x 5 window", ("edges.depth_rule=window",)),
    Variant("depth: the pixel's own", ("edges.depth_rule=window", "edges.depth_window_px=1")),
    Variant("depth: 3 x 3 window", ("edges.depth_rule=window", "edges.depth_window_px=3")),
    Variant("depth: 7 x 7 window", ("edges.depth_rule=window", "edges.depth_window_px=7")),
    Variant("depth: specks kept", ("edges.strays=kept",)),
    Variant("depth: specks left out", ("edges.strays=left-out",)),
    Variant("samples: 250", ("sampling.count=250", "sampling.max_growth=1")),
    Variant("samples: 450", ("sampling.count=450", "sampling.max_growth=1")),
    Variant("samples: 1000", ("sampling.count=1000", "sampling.max_growth=1")),
    Variant("samples: 1500", ("sampling.count=1500", "sampling.max_growth=1")),
    Variant("samples: 1500 and up to 4500", ("sampling.count=1500", "sampling.max_growth=3")),
    Variant("samples: cells of 40 px", ("sampling.cell_px=40",)),
    Variant("samples: cells of 160 px", ("sampling.cell_px=160",)),
    Variant("samples: at random, no cells", ("sampling.per_cell=0",)),
    Variant("samples: at random", ("sampling.selection=random",)),
    Variant("samples: those that tell most", ("sampling.selection=informative",)),
    Variant("matching: normal criterion alone", ("matching.criterion=normal",)),
    Variant("matching: robust criterion alone", ("matching.criterion=robust",)),
    Variant("matching: switch at 0.25 px", ("matching.switch_px=0.25",)),
    Variant("matching: switch at 2 px", ("matching.switch_px=2",)),
    Variant("matching: none beyond 10 px", ("matching.max_distance_px=10",)),
    Variant("matching: none beyond 60 degrees", ("matching.max_angle_deg=60",)),
    Variant("edges that look otherwise count alike", ("registration.profile_spread=0",)),
    Variant("edges that look otherwise count less", ("registration.profile_spread=3",)),
    Variant("steps: none stretched", ("registration.max_stretch=1",)),
    Variant("steps: stretched to three times", ("registration.max_stretch=3",)),
    Variant("steps: points matched anew after each", ("registration.kept_px=0",)),
    Variant("steps: short ones leave points on their planes", ("registration.kept_px=0.25",)),
    Variant("steps: until one is below 0.03 px", ("registration.stop_share=0",)),
    Variant("steps: until one is below 5 % of the scale, too", ("registration.stop_share=0.05",)),
    Variant("far steps: iterated like near ones", ("registration.far_leave_px=0",)),
    Variant("far steps: iterated until 0.08 px are left", ("registration.far_leave_px=0.08",)),
    Variant("far steps: no edges looked up first", ("registration.coarse_samples=0",)),
    Variant("far steps: edges looked up first", ("registration.coarse_samples=375",)),
    Variant("first stage: scale of the residuals", ("registration.first_sigma_px=0",)),
    Variant("first stage: scale of 0.5 px at least", ("registration.first_sigma_px=0.5",)),
    Variant("first stage: all samples", ("registration.first_samples=0",)),
    Variant("first stage: 700 samples at least", ("registration.first_samples=700",)),
    Variant("residual: distance, Eq. (5)", ("registration.residual=distance",)),
    Variant("weights: none", ("registration.weight=none",)),
    Variant("weights: t, nu = 2", ("registration.weight=t", "registration.nu=2")),
    Variant("weights: t, nu = 5", ("registration.weight=t", "registration.nu=5")),
    Variant("weights: Huber", ("registration.weight=huber",)),
    Variant("weights: Cauchy", ("registration.weight=cauchy",)),
    Variant("weights: Tukey", ("registration.weight=tukey",)),
    Variant("keyframe: every frame", ("keyframes.rule=gap", "keyframes.gap_frames=1")),
    Variant("keyframe: every 5 frames", ("keyframes.rule=gap", "keyframes.gap_frames=5")),
    Variant("keyframe: every 10 frames", ("keyframes.rule=gap", "keyframes.gap_frames=10")),
    Variant("keyframe: every 20 frames", ("keyframes.rule=gap", "keyframes.gap_frames=20")),
    Variant(
        "keyframe: after 0.1 m or 8 degrees",
        ("keyframes.max_translation_m=0.1", "keyframes.max_rotation_deg=8"),
    ),
    Variant("keyframe: after 0.3 m", ("keyframes.max_translation_m=0.3",)),
    Variant("keyframe: after 0.15 m", ("keyframes.max_translation_m=0.15",)),
    Variant("keyframe: placed by the last one alone", ("keyframes.window=1",)),
    Variant("keyframe: placed by the last ones together", ("keyframes.window=5",)),
    Variant("keyframe: gives way where light has changed", ("keyframes.gather_share=0",)),
    Variant("keyframe: gathers edges where light has changed", ("keyframes.gather_share=0.33",)),
    Variant("keyframe: with the edges of its frame", ("keyframes.edge_scale=1",)),
    Variant("keyframe: with fainter edges, too", ("keyframes.edge_scale=0.7",)),
    Variant("keyframe: earlier where well constrained", ("keyframes.early_share=0.67",)),
    Variant("depth: at the instant of colour", ("motion.depth_delay=none",)),
    Variant("depth: at the instant of its stamp", ("motion.depth_delay=stamps",)),
    Variant("depth: at the instant measured", ("motion.depth_delay=measured",)),
    Variant("depth: where the velocity puts it", ("motion.depth_slack=none",)),
    Variant("depth: elsewhere, as one, by acceleration", ("motion.depth_slack=measured",)),
    Variant("rows: where the velocity puts them", ("motion.row_slack=none",)),
    Variant("rows: elsewhere by acceleration", ("motion.row_slack=measured",)),
    Variant("depth that repeats: taken for new", ("motion.repeated_depth=new",)),
    Variant("depth that repeats: recognised", ("motion.repeated_depth=recognised",)),
    Variant("rows: all at once", ("motion.readout=none",)),
    Variant("rows: one after the other, as measured", ("motion.readout=measured",)),
    Variant("smeared edges: count like others", ("motion.exposure=none",)),
    Variant("smeared edges: count less, as measured", ("motion.exposure=measured",)),
    Variant("search: none where in doubt", ("motion.search_deg=0",)),
    Variant("in doubt: not from aside", ("motion.aside_px=0",)),
    Variant("in doubt: from 4 px aside, too", ("motion.aside_px=4",)),
    Variant("where the last keyframe does not fit: lost", ("keyframes.earlier=0",)),
    Variant("where the last keyframe does not fit: an earlier one", ("keyframes.earlier=4",)),
    Variant("recovery: none", ("keyframes.stored=0",)),
    Variant("without edges: lost", ("planes.alone_share=0",)),
    Variant("without edges: depth alone", ("planes.alone_share=0.5",)),
    Variant("start: where the camera was", ("motion.prior=still",)),
    Variant("start: chosen by one sample in four", ("motion.prior_stride=4",)),
    Variant("start: chosen by one sample in eight", ("motion.prior_stride=8",)),
    Variant("inertia: none", ("motion.inertia=none",)),
    Variant("inertia: where hardly anything constrains", ("motion.inertia=loose",)),
    Variant("edges that tell are left out: not asked", ("status.min_told=0",)),
    Variant("edges that tell are left out: asked", ("status.min_told=0.25",)),
    Variant("edges that scatter more than others: left out", ("registration.own_scale_px=0",)),
    Variant(
        "edges that scatter more than others: by a scale of their own",
        ("registration.own_scale_px=3",),
    ),
    Variant("a frame that tells far more: no keyframe", ("keyframes.tells_times=0",)),
    Variant("a frame that tells far more: a keyframe", ("keyframes.tells_times=4",)),
    Variant("edges that fit nowhere: not looked for", ("motion.along_px=0",)),
    Variant("edges that fit nowhere: looked for along a motion", ("motion.along_px=40",)),
    Variant("witness: none", ("status.max_conflict=0",)),
    Variant("witness: what stands where nothing was", ("status.max_conflict=0.02",)),
    Variant("what moves: followed like the rest", ("status.moving=follow",)),
    Variant("what moves: left out", ("status.moving=leave-out",)),
    Variant("what moves slowly: followed like the rest", ("status.moving_m=0",)),
    Variant("what moves slowly: left out", ("status.moving_m=0.35",)),
    Variant("a view that changes at once: ignored", ("status.sudden_change=ignore",)),
    Variant("a view that changes at once: doubted", ("status.sudden_change=doubt",)),
    Variant("lost for a second: wait", ("status.lost=wait",)),
    Variant("lost for a second: begin anew", ("status.lost=begin-anew",)),
    Variant("edges and depth that are torn: ignored", ("status.torn=ignore",)),
    Variant("edges and depth that are torn: doubted", ("status.torn=doubt",)),
    Variant("covariance: none", ("status.covariance=none",)),
    Variant("covariance: by cells", ("status.covariance=cells",)),
    Variant("covariance: by cells and instants", ("status.covariance=instants",)),
    Variant("edges that one image has in view: counted", ("status.unshared=counted",)),
    Variant("edges that one image has in view: excused", ("status.unshared=excused",)),
    Variant("leaps: lost", ("status.leaps=lost",)),
    Variant("leaps: asked", ("status.leaps=asked",)),
    Variant("just lost: as any frame", ("status.just_lost=as-any",)),
    Variant("just lost: by faint edges", ("status.just_lost=by-faint-edges",)),
    Variant("edges that scatter at once: left", ("status.edge_jump=0",)),
    Variant("edges that scatter at once: anew", ("status.edge_jump=2.5",)),
    Variant("agreeing gradients: not asked", ("status.min_agreeing=0", "status.doubt_agreeing=0")),
    Variant("agreeing gradients: asked", ("status.min_agreeing=0.4", "status.doubt_agreeing=0.5")),
    Variant("the first second: as any other", ("status.first_agreeing=0",)),
    Variant("the first second: edges have to agree", ("status.first_agreeing=0.7",)),
)
"""Changes of every part, whatever the preset."""


def variants_of(preset: str) -> dict[str, Config]:
    """Apply each change to a preset.

    Parameters
    ----------
    preset : str
        ``paper`` or ``default``.

    Returns
    -------
    dict of str to Config
        By the names of `VARIANTS`, without those that the preset has already.

    Raises
    ------
    ConfigError
        If there is no such preset.
    """
    unchanged = Config.preset(preset)
    changed = {v.name: unchanged.with_overrides(v.changes) for v in VARIANTS}
    return {name: config for name, config in changed.items() if config != unchanged}
