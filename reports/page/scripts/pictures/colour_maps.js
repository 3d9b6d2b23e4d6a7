// Numbers 0 … 1 as colours. Magma and viridis are Matplotlib's (CC0): every fifth of their 256 colours as six hexadecimal
// digits; interpolation between them is off by one level at most.
const colourMaps = (() => {
  const MAGMA =
    "00000402020b0504160907200e0b2b140e361a104221114e29115a311165390f6e420f754a107952137c5a167e6219806a1c8172" +
    "1f81792282812581892881912b81992d80a1307eaa337db2357bba3878c23b75ca3e72d2426fd9466be04c67e75263ec5860f160" +
    "5df4695cf7725cf97b5dfb8560fc8e64fd9869fea16efeaa74feb47bfebd82fec68afecf92fed89afde2a3fdebacfcf4b6fcfdbf";
  const VIRIDIS =
    "44015446085c471063481769481d6f482475472a7a46307e453781433d844142873f48893d4e8a3a538b38598c355e8d33638d31" +
    "688e2e6d8e2c718e2a768e297b8e27808e25848e23898e218e8d20928c1f978b1e9c891fa18821a58524aa8328ae802eb37c35b7" +
    "793dbc7446c06f50c46a5ac86465cb5e70cf577cd25089d54895d840a2da37b0dd2fbddf26cae11fd8e219e5e419f1e51dfde725";
  // Blue (less) over white (none) to orange-red (more): distinguishable with any colour vision, and lightness gives the size.
  const DIVERGING = "08306b4292c6f7f7f7f169137f2704";

  // 256 colours, three bytes each.
  function table(text) {
    const anchors = text.match(/.{6}/g).map((digits) => digits.match(/../g).map((byte) => parseInt(byte, 16)));
    return Uint8Array.from({ length: 768 }, (_, place) => {
      const at = (Math.floor(place / 3) / 255) * (anchors.length - 1);
      const low = Math.min(anchors.length - 2, Math.floor(at));
      const [from, to] = [anchors[low][place % 3], anchors[low + 1][place % 3]];
      return Math.round(from + (at - low) * (to - from));
    });
  }

  const tables = { magma: table(MAGMA), viridis: table(VIRIDIS), diverging: table(DIVERGING), grey: table("000000ffffff") };

  // Values → RGBA bytes, `low` … `high` over the full table; NaN stays transparent.
  function paint(values, name, low, high) {
    const bytes = new Uint8ClampedArray(4 * values.length);
    values.forEach((value, place) => {
      const part = (value - low) / (high - low);
      if (Number.isNaN(part)) return;
      const at = 3 * Math.round(255 * Math.min(1, Math.max(0, part)));
      bytes.set(tables[name].subarray(at, at + 3), 4 * place);
      bytes[4 * place + 3] = 255;
    });
    return bytes;
  }

  // A CSS gradient from left to right.
  function gradient(name) {
    const stops = Array.from({ length: 18 }, (_, place) => `rgb(${tables[name].slice(45 * place, 45 * place + 3).join(" ")})`);
    return `linear-gradient(90deg, ${stops.join(", ")})`;
  }

  return { paint, gradient };
})();
