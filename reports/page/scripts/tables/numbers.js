// Numbers as text: true minus signs, fixed decimals, a dash for a missing value.
const numbers = (() => {
  const MINUS = "\u2212";
  const NOTHING = "\u2013";

  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));

  function fixed(value, digits) {
    if (!Number.isFinite(value)) return NOTHING;
    const text = value.toFixed(digits);
    return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", MINUS);
  }

  function signed(value, digits) {
    const text = fixed(value, digits);
    return /^\d/.test(text) && Number(text) !== 0 ? `+${text}` : text;
  }

  // Four significant digits for any magnitude.
  function brief(value) {
    if (!Number.isFinite(value)) return NOTHING;
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e7)) return value.toExponential(2).replace(/-/g, MINUS).replace("e+", "e");
    if (Number.isInteger(value)) return grouped(value);
    return String(Number(value.toPrecision(4))).replace("-", MINUS);
  }

  // 493 056 with narrow spaces.
  function grouped(value) {
    return String(value).replace("-", MINUS).replace(/\B(?=(\d{3})+(?!\d))/g, "\u202f");
  }

  function seconds(value) {
    if (value === null || value === undefined) return NOTHING;
    if (value < 120) return `${fixed(value, value < 10 ? 1 : 0)}\u202fs`;
    const whole = Math.round(value);
    const two = (part) => String(part).padStart(2, "0");
    if (whole < 7200) return `${Math.floor(whole / 60)} min ${two(whole % 60)} s`;
    return `${Math.floor(whole / 3600)} h ${two(Math.floor((whole % 3600) / 60))} min`;
  }
  return { clamp, fixed, signed, brief, grouped, seconds, NOTHING };
})();
