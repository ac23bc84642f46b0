"""Which model of `edvo.sensor` measures alike to a camera, by what its maker calls it."""

# The first part that is in the name tells. Where no model was made for a camera, the one that is
# nearest: for D405 and Gemini a stereo camera with a wide view.
_PARTS = {
    "D410": "realsense_d415",
    "D415": "realsense_d415",
    "L515": "azure_kinect",
    "D4": "realsense_d435",
    "Femto": "azure_kinect",
    "Astra": "kinect_v1",
    "Gemini": "realsense_d435",
    "OAK": "realsense_d435",
}


def noise_of(name: str) -> str | None:
    """Find the depth noise of a camera.

    Parameters
    ----------
    name : str
        Its make and model, such as ``"Intel RealSense D435"``.

    Returns
    -------
    str or None
        A name that `planes.sensor` takes; None for a camera that nothing is known of.
    """
    return next((noise for part, noise in _PARTS.items() if part in name), None)
