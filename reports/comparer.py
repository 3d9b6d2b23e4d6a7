"""The picture comparer of the page: its scripts, in order; after state.js, element.js, numbers.js and filter.js."""

SCRIPTS = (
    "chunks.js",
    "kept.js",
    "pixels.js",
    "colour_space.js",
    "colour_maps.js",
    "delta_e.js",
    "flip.js",
    "error_maps.js",
    "zoom.js",
    "compare_data.js",
    "thumbnails.js",
    "compare_choice.js",
    "compare_layers.js",
    "compare_panel.js",
    "compare_view.js",
    "compare_probe.js",
    "compare_controls.js",
    "compare_keys.js",
    "compare_export.js",
    "compare.js",
)
