// sRGB ↔ linear light ↔ XYZ ↔ CIELAB, D65, 2° observer; constants as in colour-science.
const colourSpace = (() => {
  const WHITE = [0.3127 / 0.329, 1, (1 - 0.3127 - 0.329) / 0.329];
  const TO_XYZ = [
    [0.4124, 0.3576, 0.1805],
    [0.2126, 0.7152, 0.0722],
    [0.0193, 0.1192, 0.9505],
  ];
  const EDGE = (6 / 29) ** 3;

  // Display value 0 … 1 → linear light (IEC 61966-2-1).
  const decode = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);

  // Linear light, clipped to 0 … 1 → display value.
  const encode = (v) => {
    const x = numbers.clamp(v, 0, 1);
    return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
  };

  const bent = (t) => (t > EDGE ? Math.cbrt(t) : t / (3 * (6 / 29) ** 2) + 4 / 29);

  // Linear light, three numbers → CIELAB, written to `lab`.
  function toLab(r, g, b, lab) {
    const [x, y, z] = TO_XYZ.map((row, place) => bent((row[0] * r + row[1] * g + row[2] * b) / WHITE[place]));
    lab[0] = 116 * y - 16;
    lab[1] = 500 * (x - y);
    lab[2] = 200 * (y - z);
  }

  return { decode, encode, toLab };
})();
