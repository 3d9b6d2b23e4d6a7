// The maps of a picture: their names, colours, ranges, arithmetic and figures.
// Each works on { test, truth, opaque }: two loaded pictures (see compare_data.js) and the opacity of the ground truth,
// which is not `truth` if two methods are compared.
const errorMaps = (() => {
  const LUMA = [0.2126, 0.7152, 0.0722];
  const EVEN = [1 / 3, 1 / 3, 1 / 3];
  const OPAQUE = 0.99;
  const LIGHT_FLOOR = 0.01;

  // The weighted sum over the channels of `of(difference)`.
  function* differences({ test, truth }, weights, of) {
    const values = new Float32Array(test.width * test.height);
    for (let place = 0; place < values.length; place += 1) {
      const difference = (which) => weights[which] * of(test.planes[which][place] - truth.planes[which][place]);
      values[place] = difference(0) + difference(1) + difference(2);
      if (place % test.width === 0) yield;
    }
    return values;
  }

  const known = (values) => values.filter((value) => !Number.isNaN(value));

  // The mean of the values that are not NaN.
  function mean(values, of = (v) => v) {
    const numeric = known(Array.from(values));
    return numeric.reduce((sum, value) => sum + of(value), 0) / numeric.length;
  }

  // The median, and the values that 95 and 99 of 100 pixels lie below: a mean hides whether an error is local.
  function quantiles(values, digits) {
    const sorted = known(values).sort();
    const at = (share) => fixed(sorted[Math.max(0, Math.ceil(share * sorted.length) - 1)], digits);
    return `median ${at(0.5)}, 95 % below ${at(0.95)}, 99 % below ${at(0.99)}`;
  }

  // The mean over the channels of `of(light, true light)`.
  function* ofLight({ test, truth }, of) {
    const [tested, reference] = [test.light, truth.light];
    const values = new Float32Array(test.width * test.height);
    for (let place = 0; place < values.length; place += 1) {
      for (const which of [0, 1, 2]) values[place] += of(tested[which][place], reference[which][place]) / 3;
      if (place % test.width === 0) yield;
    }
    return values;
  }

  const noise = (record) => (Number.isFinite(record?.noise) ? `; noise of the truth ${fixed(record.noise, 4)} (RMS)` : "");
  const square = (v) => v * v;
  const fixed = (value, digits) => (value === Infinity ? "∞" : numbers.fixed(value, digits));
  const recorded = (value, digits) => (Number.isFinite(value) ? ` (record ${fixed(value, digits)})` : "");

  function squaredError({ test, truth }) {
    return mean(test.planes.map((plane, which) => mean(plane.map((v, place) => square(v - truth.planes[which][place])))));
  }

  // `range`: the largest value that the colours show; the reader can change it in maps with `scaled`.
  // `alone`: a map of one picture, without comparison. `depth`: it needs depth. `hdr`: a map of light, offered if the truth
  // is brighter than white.
  // `said(values, pair, record)`: its figures as text; `record` has the scores of the same view, or is null.
  const MAPS = {
    colour: {
      title: "Colour",
      said: (_, pair, record) => {
        const error = squaredError(pair);
        return `PSNR ${fixed(error === 0 ? Infinity : -10 * Math.log10(error), 2)} dB${recorded(record?.psnr, 2)}`;
      },
    },
    signed: {
      title: "Signed error",
      titled: `Signed error of luma (${LUMA.map((weight, which) => `${weight} ${"RGB"[which]}`).join(" + ")})`,
      about: "display value, less … more than",
      colours: "diverging", range: 0.25, signed: true, scaled: true,
      work: (pair) => differences(pair, LUMA, (v) => v),
      // errors of opposite sign cancel in luma, so that the RMSE of luma is not that of the picture
      said: (values, pair, record) =>
        `mean ${fixed(mean(values), 4)}, RMSE of all channels ${fixed(Math.sqrt(squaredError(pair)), 4)}${noise(record)}`,
    },
    absolute: {
      title: "Absolute error", about: "display value", colours: "magma", range: 0.25, scaled: true,
      work: (pair) => differences(pair, EVEN, Math.abs),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}, ${quantiles(values, 4)}${noise(record)}`,
    },
    flip: {
      title: "FLIP", about: "FLIP, 67 pixels per degree", colours: "magma", range: 1,
      work: ({ test, truth }) => flip.map(truth.planes, test.planes, test.width, test.height),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}${recorded(record?.flip, 4)}, ${quantiles(values, 3)}`,
    },
    delta_e: {
      title: "ΔE₀₀", about: "CIEDE2000", colours: "magma", range: 20, scaled: true,
      work: ({ test, truth }) => deltaE.map(truth.planes, test.planes, test.width, test.height),
      said: (values, _, record) => `mean ${fixed(mean(values), 2)}${recorded(record?.delta_e, 2)}, ${quantiles(values, 1)}`,
    },
    rel_mse: {
      title: "relMSE", about: "squared error of light over true light² + 0.01", colours: "magma", range: 1, scaled: true, hdr: true,
      work: (pair) => ofLight(pair, (x, t) => square(x - t) / (t * t + LIGHT_FLOOR)),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}${recorded(record?.rel_mse, 4)}, ${quantiles(values, 4)}`,
    },
    smape: {
      title: "SMAPE", about: "error of light over the sum of both + 0.01", colours: "magma", range: 1, hdr: true,
      work: (pair) => ofLight(pair, (x, t) => Math.abs(x - t) / (Math.abs(x) + Math.abs(t) + LIGHT_FLOOR)),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}${recorded(record?.smape, 4)}, ${quantiles(values, 4)}`,
    },
    hdr_flip: {
      title: "HDR-FLIP", about: "FLIP, the largest over exposures", colours: "magma", range: 1, hdr: true,
      work: ({ test, truth }) => flip.hdr(truth.light, test.light, test.width, test.height),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}${recorded(record?.hdr_flip, 4)}, ${quantiles(values, 3)}`,
    },
    depth_error: {
      title: "Depth error", about: "scene units, nearer … farther than; where the truth is opaque",
      colours: "diverging", range: 0.5, signed: true, scaled: true, depth: true,
      work: function* ({ test, truth, opaque }) {
        return test.depth.map((depth, place) => (opaque[place] > OPAQUE ? depth - truth.depth[place] : NaN));
      },
      said: (values) => {
        const average = mean(values);
        if (Number.isNaN(average)) return "no opaque pixel";
        return `RMSE ${fixed(Math.sqrt(mean(values, square)), 4)}, mean ${fixed(average, 4)}`;
      },
    },
    depth: {
      title: "Depth", about: "scene units along the ray", colours: "viridis", alone: true, depth: true,
      work: function* ({ test }) {
        return test.isTruth ? test.depth.map((v) => (v === 0 ? NaN : v)) : test.depth;
      },
      said: (values) => {
        const hit = known(values).sort();
        return hit.length > 0 ? `${fixed(hit[0], 2)} to ${fixed(hit.at(-1), 2)}` : "nothing was hit";
      },
    },
    opacity: {
      title: "Opacity", about: "opacity", colours: "grey", range: 1, alone: true,
      work: function* ({ test }) {
        return test.opacity;
      },
      said: (values) => `mean ${fixed(mean(values), 3)}`,
    },
  };

  // The names of the maps that a view has.
  const namesOf = (view) => Object.keys(MAPS).filter((name) => view.hdr || !MAPS[name].hdr);
  const titleOf = (name) => MAPS[name].titled ?? MAPS[name].title;

  // The values at the two ends of the colours: near and far of the view for depth, else the range that the reader scaled.
  function endsOf(name, scale, view) {
    const { range, scaled, signed } = MAPS[name];
    if (name === "depth") return [view.near, view.far];
    const most = scaled ? range * 2 ** scale : range;
    return [signed ? -most : 0, most];
  }

  return { MAPS, namesOf, titleOf, endsOf };
})();
