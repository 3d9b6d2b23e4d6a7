"""Stiff and extreme scenes. Each is an ordinary scene, and what a ray of it sees is known in closed form.

`scenes.catalog.STRESS` names them; `scene_named(name).truth(o, d)` answers (`scenes.truth.Seen`), and
`scenes.truth.pixel_means` makes pixels of it.

    plain     empty black white wall
    rooms     inside furnace
    fog       fog_dense fog_thin
    wires     wires
    mirror    mirror
    glass     glass glass_air
    light     hdr_emitter grazing
    checker   checker
    scales    tiny huge: no closed form, their truth is a render of `scales.UNIT`, the same scene at unit scale

Parameters that a test may want are module constants and the functions `plain.textured_ball`, `fog.fog`,
`wires.wires`, `glass.glass`, `light.hdr`, `scales.described`.
"""
