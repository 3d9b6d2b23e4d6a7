// The maps that a picture can be looked at through: their names, colours, ranges, arithmetic and figures.
// Each works on a pair { test, truth, opaque } of loaded pictures (planes of display colour, opacity, depth: see
// compare_data.js) and the opacity of the ground truth, which is not `truth` where two methods are compared.
const errorMaps = (() => {
  const LUMA = [0.2126, 0.7152, 0.0722];
  const CHANNELS = { all: "all channels", red: "red", green: "green", blue: "blue" };
  const OPAQUE = 0.99;

  const channelOf = (name) => ["red", "green", "blue"].indexOf(name);

  // `of(difference of each channel)`, summed with weights over all channels, or of one alone.
  function* differences({ test, truth }, channel, weights, of) {
    const found = new Float32Array(test.width * test.height);
    const one = channelOf(channel);
    for (let place = 0; place < found.length; place += 1) {
      const difference = (which) => of(test.planes[which][place] - truth.planes[which][place]);
      found[place] =
        one >= 0
          ? difference(one)
          : weights[0] * difference(0) + weights[1] * difference(1) + weights[2] * difference(2);
      if (place % test.width === 0) yield;
    }
    return found;
  }

  const EVEN = [1 / 3, 1 / 3, 1 / 3];

  function* depthError({ test, truth, opaque }) {
    const found = new Float32Array(test.width * test.height).fill(NaN);
    for (let place = 0; place < found.length; place += 1) {
      if (opaque[place] > OPAQUE) found[place] = test.depth[place] - truth.depth[place];
    }
    return found;
  }

  function* depth({ test }) {
    return test.isTruth ? test.depth.map((v) => (v === 0 ? NaN : v)) : test.depth;
  }

  function mean(values, of = (v) => v) {
    let sum = 0;
    let many = 0;
    for (const value of values) {
      if (Number.isNaN(value)) continue;
      sum += of(value);
      many += 1;
    }
    return many ? sum / many : NaN;
  }

  const psnrOf = (error) => (error === 0 ? Infinity : -10 * Math.log10(error));
  const fixed = (value, digits) => (value === Infinity ? "∞" : numbers.fixed(value, digits));
  const beside = (value, digits) => (value === null || value === undefined ? "" : ` (record ${fixed(value, digits)})`);
  const squares = (pair) => [0, 1, 2].reduce((sum, which) => {
    const [one, other] = [pair.test.planes[which], pair.truth.planes[which]];
    let total = 0;
    for (let place = 0; place < one.length; place += 1) total += (one[place] - other[place]) ** 2;
    return sum + total / one.length / 3;
  }, 0);

  // `range` is the largest value that the colours tell apart; maps with `scaled` let the reader change it.
  // `titled`: its title over all channels, where these are not weighed alike.
  // `said(values, pair, record, channel)`: its figures in words; `record` has psnr, flip and delta_e of the same view or null.
  const MAPS = {
    colour: {
      title: "Colour",
      said: (_, pair, record) =>
        pair ? `PSNR ${fixed(psnrOf(squares(pair)), 2)} dB${beside(record?.psnr, 2)}` : "",
    },
    signed: {
      title: "Signed error",
      titled: `Signed error of luma (${LUMA.map((weight, which) => `${weight} ${"RGB"[which]}`).join(" + ")})`,
      about: "display value, less … more than",
      colours: "diverging",
      range: 0.25,
      signed: true,
      scaled: true,
      channelled: true,
      needs: ["planes"],
      work: (pair, channel) => differences(pair, channel, LUMA, (v) => v),
      // errors of opposite sign cancel in luma, so that its own RMSE would not be the picture's
      said: (values, pair, _, channel) =>
        channel === "all"
          ? `mean ${fixed(mean(values), 4)}, RMSE of all channels ${fixed(Math.sqrt(squares(pair)), 4)}`
          : `mean ${fixed(mean(values), 4)}, RMSE ${fixed(Math.sqrt(mean(values, (v) => v * v)), 4)}`,
    },
    absolute: {
      title: "Absolute error",
      about: "display value",
      colours: "magma",
      range: 0.25,
      scaled: true,
      channelled: true,
      needs: ["planes"],
      work: (pair, channel) => differences(pair, channel, EVEN, Math.abs),
      said: (values) => `mean ${fixed(mean(values), 4)}`,
    },
    squared: {
      title: "Squared error",
      about: "display value²",
      colours: "magma",
      range: 0.0625,
      scaled: true,
      channelled: true,
      needs: ["planes"],
      work: (pair, channel) => differences(pair, channel, EVEN, (v) => v * v),
      said: (values, _, record, channel) =>
        `MSE ${mean(values).toExponential(2).replace("-", "−")}, PSNR ${fixed(psnrOf(mean(values)), 2)} dB` +
        (channel === "all" ? beside(record?.psnr, 2) : ""),
    },
    flip: {
      title: "FLIP",
      about: "FLIP, 67 pixels a degree",
      colours: "magma",
      range: 1,
      needs: ["planes"],
      work: ({ test, truth }) => flip.map(truth.planes, test.planes, test.width, test.height),
      said: (values, _, record) => `mean ${fixed(mean(values), 4)}${beside(record?.flip, 4)}`,
    },
    delta_e: {
      title: "ΔE₀₀",
      about: "CIEDE2000",
      colours: "magma",
      range: 20,
      scaled: true,
      needs: ["planes"],
      work: ({ test, truth }) => deltaE.map(truth.planes, test.planes, test.width, test.height),
      said: (values, _, record) => `mean ${fixed(mean(values), 2)}${beside(record?.delta_e, 2)}`,
    },
    depth_error: {
      title: "Depth error",
      about: "scene units, nearer … farther than; where the truth is opaque",
      colours: "diverging",
      range: 0.5,
      signed: true,
      scaled: true,
      needs: ["depth", "opacity"],
      work: depthError,
      said: (values) =>
        Number.isNaN(mean(values))
          ? "no opaque pixel"
          : `RMSE ${fixed(Math.sqrt(mean(values, (v) => v * v)), 4)}, mean ${fixed(mean(values), 4)}`,
    },
    depth: {
      title: "Depth",
      about: "scene units along the ray",
      colours: "viridis",
      alone: true,
      needs: ["depth"],
      work: depth,
      said: (values) => {
        let [least, most] = [Infinity, -Infinity];
        for (const v of values) {
          if (v < least) least = v;
          if (v > most) most = v;
        }
        return most < least ? "nothing was hit" : `${fixed(least, 2)} to ${fixed(most, 2)}`;
      },
    },
    opacity: {
      title: "Opacity",
      about: "opacity",
      colours: "grey",
      range: 1,
      alone: true,
      needs: ["opacity"],
      work: function* ({ test }) {
        return test.opacity;
      },
      said: (values) => `mean ${fixed(mean(values), 3)}`,
    },
  };

  const titleOf = (name, channel) => (channel === "all" && MAPS[name].titled) || MAPS[name].title;

  // What lies at the two ends of the colours: of depth the view's near and far, else the range as the reader scaled it.
  function endsOf(name, scale, view) {
    const map = MAPS[name];
    if (name === "depth") return [view.near, view.far];
    const most = map.scaled ? map.range * 2 ** scale : map.range;
    return [map.signed ? -most : 0, most];
  }

  return { MAPS, CHANNELS, titleOf, endsOf };
})();
