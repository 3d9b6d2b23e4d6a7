// FLIP for displays (Andersson et al. 2020), with separable filters as in its authors' program and their default of
// 67 pixels per degree: 0.7 m from a display of 0.7 m and 3840 pixels.
const flip = (() => {
  const PIXELS_A_DEGREE = 3840 * (Math.PI / 180);
  const WHITE = [0.950428545, 1, 1.088900371];
  const TO_XYZ = [
    [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
    [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
    [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
  ];
  const FROM_XYZ = [
    [3.241003275, -1.537398934, -0.498615861],
    [-0.969224334, 1.875930071, 0.041554224],
    [0.055639423, -0.204011202, 1.057148933],
  ];
  // Contrast sensitivity as sums of Gaussians a √(π/b) exp(−π² x²/b), x in degrees; only Cz has a second term.
  const SEEN = { y: [[1, 0.0047]], cx: [[1, 0.0053]], cz: [[34.1, 0.04], [13.5, 0.025]] };
  const FEATURE_WIDTH = 0.082;
  const [COLOUR_POWER, BEND, BEND_TO, FEATURE_POWER] = [0.7, 0.4, 0.95, 0.5];
  const DELTA = 6 / 29;

  const times = (m, x, y, z) => m.map((row) => row[0] * x + row[1] * y + row[2] * z);
  const bent = (t) => (t > DELTA ** 3 ? Math.cbrt(t) : t / (3 * DELTA * DELTA) + 4 / 29);
  const clip = (v) => numbers.clamp(v, 0, 1);

  // CIELAB with Hunt's adjustment: colourfulness falls with lightness.
  function huntLab(r, g, b) {
    const [x, y, z] = times(TO_XYZ, r, g, b).map((v, place) => bent(v / WHITE[place]));
    const light = 116 * y - 16;
    return [light, 0.01 * light * 500 * (x - y), 0.01 * light * 200 * (y - z)];
  }

  const hyab = (one, other) => Math.abs(one[0] - other[0]) + Math.hypot(one[1] - other[1], one[2] - other[2]);
  const FARTHEST = hyab(huntLab(0, 1, 0), huntLab(0, 0, 1)) ** COLOUR_POWER;

  function sensitivity(terms) {
    const widest = Math.max(...Object.values(SEEN).flat().map(([, b]) => b));
    const radius = Math.ceil(3 * Math.sqrt(widest / (2 * Math.PI ** 2)) * PIXELS_A_DEGREE);
    const filters = terms.map(([a, b]) =>
      Float64Array.from({ length: 2 * radius + 1 }, (_, place) => {
        const x = (place - radius) / PIXELS_A_DEGREE;
        return Math.sqrt(a * Math.sqrt(Math.PI / b)) * Math.exp((-(Math.PI ** 2) * x * x) / b);
      }),
    );
    const sums = filters.map((filter) => filter.reduce((sum, v) => sum + v, 0));
    const norm = Math.hypot(...sums);
    return filters.map((filter) => filter.map((v) => v / norm));
  }

  // A Gaussian, and its first and second derivative whose positive and negative parts sum to ±1.
  function features() {
    const deviation = 0.5 * FEATURE_WIDTH * PIXELS_A_DEGREE;
    const radius = Math.ceil(3 * deviation);
    const at = Float64Array.from({ length: 2 * radius + 1 }, (_, place) => place - radius);
    const bell = at.map((x) => Math.exp((-x * x) / (2 * deviation ** 2)));
    const balanced = (values) => {
      const up = values.reduce((sum, v) => sum + Math.max(0, v), 0);
      const down = values.reduce((sum, v) => sum - Math.min(0, v), 0);
      return values.map((v) => v / (v > 0 ? up : down));
    };
    return [
      bell.map((v) => v / bell.reduce((sum, w) => sum + w, 0)),
      balanced(at.map((x, place) => -x * bell[place])),
      balanced(at.map((x, place) => ((x / deviation) ** 2 - 1) * bell[place])),
    ];
  }

  // `plane` filtered along rows or columns, with its last value repeated beyond the edge.
  function* filtered(plane, width, height, weights, alongRows) {
    const sums = new Float32Array(plane.length);
    const radius = (weights.length - 1) / 2;
    const [step, length] = alongRows ? [1, width] : [width, height];
    for (let row = 0; row < height; row += 1) {
      for (let column = 0; column < width; column += 1) {
        const place = row * width + column;
        const here = alongRows ? column : row;
        let sum = 0;
        for (let offset = -radius; offset <= radius; offset += 1) {
          const there = Math.min(length - 1, Math.max(0, here + offset));
          sum += weights[offset + radius] * plane[place + (there - here) * step];
        }
        sums[place] = sum;
      }
      yield;
    }
    return sums;
  }

  function* both(plane, width, height, across, down) {
    return yield* filtered(yield* filtered(plane, width, height, across, true), width, height, down, false);
  }

  // The visible part of a picture: three filtered planes of Hunt-adjusted CIELAB, and the strength of edges and points.
  function* seen(planes, width, height) {
    const opponent = [0, 1, 2].map(() => new Float32Array(width * height));
    for (let place = 0; place < width * height; place += 1) {
      const light = planes.map((plane) => colourSpace.decode(plane[place]));
      const [x, y, z] = times(TO_XYZ, ...light).map((v, which) => v / WHITE[which]);
      opponent[0][place] = 116 * y - 16;
      opponent[1][place] = 500 * (x - y);
      opponent[2][place] = 200 * (y - z);
      if (place % width === 0) yield;
    }
    const grey = opponent[0].map((v) => (v + 16) / 116);
    const smooth = [];
    for (const [which, terms] of [SEEN.y, SEEN.cx, SEEN.cz].entries()) {
      const parts = [];
      for (const filter of sensitivity(terms)) parts.push(yield* both(opponent[which], width, height, filter, filter));
      smooth.push(parts.length === 1 ? parts[0] : parts[0].map((v, place) => v + parts[1][place]));
    }
    for (let place = 0; place < width * height; place += 1) {
      const y = (smooth[0][place] + 16) / 116;
      const xyz = [y + smooth[1][place] / 500, y, y - smooth[2][place] / 200].map((v, which) => v * WHITE[which]);
      const lab = huntLab(...times(FROM_XYZ, ...xyz).map(clip));
      for (const which of [0, 1, 2]) smooth[which][place] = lab[which];
      if (place % width === 0) yield;
    }
    const [bell, edge, point] = features();
    const strengths = [];
    for (const feature of [edge, point]) {
      const across = yield* both(grey, width, height, feature, bell);
      const down = yield* both(grey, width, height, bell, feature);
      strengths.push(across.map((v, place) => Math.hypot(v, down[place])));
    }
    return { lab: smooth, strengths };
  }

  const known = new WeakMap();

  // Computed once per truth, which is compared with many renderings.
  function* seenOnce(planes, width, height) {
    if (!known.has(planes)) known.set(planes, yield* seen(planes, width, height));
    return known.get(planes);
  }

  // Display colour of two pictures, three planes each, 0 … 1 → FLIP per pixel, 0 … 1. A generator that pauses between rows.
  function* map(truth, test, width, height) {
    const one = yield* seenOnce(truth, width, height);
    const other = yield* seen(test, width, height);
    const errors = new Float32Array(width * height);
    for (let place = 0; place < errors.length; place += 1) {
      const [first, second] = [one, other].map(({ lab }) => lab.map((plane) => plane[place]));
      const far = hyab(first, second) ** COLOUR_POWER / FARTHEST;
      const colour = far < BEND ? (far * BEND_TO) / BEND : BEND_TO + ((far - BEND) / (1 - BEND)) * (1 - BEND_TO);
      const [edges, points] = [0, 1].map((kind) => Math.abs(one.strengths[kind][place] - other.strengths[kind][place]));
      const feature = (Math.max(edges, points) / Math.SQRT2) ** FEATURE_POWER;
      errors[place] = colour ** (1 - feature);
      if (place % width === 0) yield;
    }
    return errors;
  }

  // The ACES tone mapping of HDR-FLIP (Andersson et al. 2021): (a x² + b x) / (c x² + d x + e).
  const ACES = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];
  const MOST_TONE = 0.85;
  const toned = (x) => clip((x * (x * ACES[0] + ACES[1])) / (x * (x * ACES[2] + ACES[3]) + ACES[4]));

  // Exposures about one stop apart: at the first the brightest pixel of the truth is almost white, at the last its median.
  function exposures(truth) {
    const luma = Float64Array.from(truth[0], (_, place) => times(TO_XYZ, ...truth.map((plane) => plane[place]))[1]).sort();
    const [half, least] = [luma.length >> 1, 2 ** -23];
    const median = luma.length % 2 ? luma[half] : (luma[half - 1] + luma[half]) / 2;
    const [a, b, c] = [ACES[0] - MOST_TONE * ACES[2], ACES[1] - MOST_TONE * ACES[3], -MOST_TONE * ACES[4]];
    const white = (-b + Math.sqrt(b * b - 4 * a * c)) / (2 * a);
    const [first, last] = [luma.at(-1), Math.max(median, least)].map((y) => Math.log2(white / y));
    const many = Math.max(2, Math.ceil(last - first));
    return Array.from({ length: many }, (_, place) => first + (place * (last - first)) / (many - 1));
  }

  // Linear light of two pictures, three planes each → HDR-FLIP per pixel: the largest FLIP over the exposures.
  function* hdr(truth, test, width, height) {
    const largest = new Float32Array(width * height);
    for (const stops of exposures(truth)) {
      const shown = [truth, test].map((planes) =>
        planes.map((plane) => plane.map((v) => colourSpace.encode(toned(Math.max(0, v) * 2 ** stops)))));
      const values = yield* map(...shown, width, height);
      values.forEach((value, place) => (largest[place] = Math.max(largest[place], value)));
    }
    return largest;
  }

  return { map, hdr };
})();
