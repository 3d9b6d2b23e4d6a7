// The CIEDE2000 colour difference (Sharma, Wu and Dalal 2005), all weights 1.
const deltaE = (() => {
  const DEGREE = Math.PI / 180;
  const SEVENTH = 25 ** 7;

  const hueOf = (a, b) => (a === 0 && b === 0 ? 0 : (Math.atan2(b, a) / DEGREE + 360) % 360);

  // Two CIELAB colours → ΔE₀₀.
  function between([l1, a1, b1], [l2, a2, b2]) {
    const chroma = ((Math.hypot(a1, b1) + Math.hypot(a2, b2)) / 2) ** 7;
    const stretched = 1 + 0.5 * (1 - Math.sqrt(chroma / (chroma + SEVENTH)));
    const c1 = Math.hypot(stretched * a1, b1);
    const c2 = Math.hypot(stretched * a2, b2);
    const h1 = hueOf(stretched * a1, b1);
    const h2 = hueOf(stretched * a2, b2);
    const grey = c1 * c2 === 0;

    let turn = h2 - h1;
    if (turn > 180) turn -= 360;
    if (turn < -180) turn += 360;
    const dHue = grey ? 0 : 2 * Math.sqrt(c1 * c2) * Math.sin((turn / 2) * DEGREE);

    let hue = h1 + h2;
    if (!grey) {
      if (Math.abs(h1 - h2) > 180) hue += hue < 360 ? 360 : -360;
      hue /= 2;
    }
    const wave = (times, shift) => Math.cos((times * hue + shift) * DEGREE);
    const t = 1 - 0.17 * wave(1, -30) + 0.24 * wave(2, 0) + 0.32 * wave(3, 6) - 0.2 * wave(4, -63);

    const c = (c1 + c2) / 2;
    const away = ((l1 + l2) / 2 - 50) ** 2;
    const forLightness = (l2 - l1) / (1 + (0.015 * away) / Math.sqrt(20 + away));
    const forChroma = (c2 - c1) / (1 + 0.045 * c);
    const forHue = dHue / (1 + 0.015 * c * t);
    const rotation =
      -2 * Math.sqrt(c ** 7 / (c ** 7 + SEVENTH)) * Math.sin(60 * Math.exp(-(((hue - 275) / 25) ** 2)) * DEGREE);
    return Math.sqrt(forLightness ** 2 + forChroma ** 2 + forHue ** 2 + rotation * forChroma * forHue);
  }

  // Display colour of two pictures, three planes each, 0 … 1 → ΔE₀₀ per pixel. A generator that pauses between rows.
  function* map(first, second, width, height) {
    const errors = new Float32Array(width * height);
    const labs = [[0, 0, 0], [0, 0, 0]];
    for (let row = 0; row < height; row += 1) {
      for (let place = row * width; place < (row + 1) * width; place += 1) {
        for (const [which, planes] of [first, second].entries()) {
          const [r, g, b] = planes.map((plane) => colourSpace.decode(plane[place]));
          colourSpace.toLab(r, g, b, labs[which]);
        }
        errors[place] = between(labs[0], labs[1]);
      }
      yield;
    }
    return errors;
  }

  return { between, map };
})();
