// The comparer's controls: made once, then set to what is chosen. `choose(changes, soon)` takes keys of the address.
const compareControls = (() => {
  const PLAY = 700;

  function select(label, options) {
    const input = element("select", { "aria-label": label });
    const set = (entries, value) => {
      const key = JSON.stringify(entries);
      if (input.dataset.entries !== key) {
        input.dataset.entries = key;
        input.replaceChildren(...entries.map(([name, text]) => element("option", { value: name }, text)));
      }
      input.value = value;
    };
    input.addEventListener("change", () => options(input.value));
    return { whole: element("label", {}, element("span", {}, label), input), input, set };
  }

  function buttons(label, names, press) {
    const all = Object.entries(names).map(([name, text]) => {
      const one = element("button", { type: "button", "data-name": name }, text);
      one.addEventListener("click", (event) => press(name, event));
      return one;
    });
    const whole = element("div", { role: "group", "aria-label": label, class: "choices" }, ...all);
    const set = (chosen) => all.forEach((one) => one.setAttribute("aria-pressed", String(chosen.includes(one.dataset.name))));
    return { whole, set };
  }

  function slider(label, least, most, step, moved) {
    const input = element("input", { type: "range", "aria-label": label, min: least, max: most, step });
    const output = element("output", {});
    input.addEventListener("input", () => moved(Number(input.value)));
    return { whole: element("label", { class: "slider" }, element("span", {}, label), input, output), input, output };
  }

  function button(text, label, pressed) {
    const one = element("button", { type: "button", "aria-label": label, title: label }, text);
    one.addEventListener("click", pressed);
    return one;
  }

  function controls({ choose, act, choice }) {
    const scene = select("Scene", (name) => choose({ scene: name }));
    const view = select("View", (name) => choose({ view: name }));
    const seed = select("Seed", (name) => choose({ seed: name }));
    const modes = buttons("How to compare", compareChoice.MODES, (name) => choose({ "compare.mode": name }));
    const titles = Object.fromEntries(Object.entries(errorMaps.MAPS).map(([name, map]) => [name, map.title]));
    const more = button("+ row", "Add a row of maps instead of changing it (Shift)", () => {
      more.setAttribute("aria-pressed", String(more.getAttribute("aria-pressed") !== "true"));
    });
    more.setAttribute("aria-pressed", "false");
    const adds = (event) => event.shiftKey || more.getAttribute("aria-pressed") === "true";
    const maps = buttons("What to show", titles, (name, event) => act.map(name, adds(event)));
    maps.whole.append(more);
    const a = select("A", (name) => choose({ "compare.a": name }));
    const b = select("B", (name) => choose({ "compare.b": name }));
    const swap = button("⇄", "Swap A and B (F)", () => act.swap());
    const pair = element("div", { class: "pair" }, a.whole, swap, b.whole);

    const step = slider("Checkpoint", 0, 0, 1, (place) => choose({ step: choice().steps[place] }, true));
    const play = button("▶", "Play the checkpoints (P)", () => act.play());
    step.whole.append(play);
    const exposure = slider("Exposure", -compareChoice.EXPOSURES, compareChoice.EXPOSURES, 0.1, (stops) =>
      choose({ "compare.ev": stops || null }, true),
    );
    const reset = button("↺", "Exposure 0 (R)", () => choose({ "compare.ev": null }));
    exposure.whole.append(reset);
    const range = slider("Range of colours", -6, 3, 1, (scale) => choose({ "compare.range": scale || null }, true));
    const channel = select("Channel", (name) => choose({ "compare.channel": name === "all" ? null : name }));
    channel.set(Object.entries(errorMaps.CHANNELS), "all");
    const magnified = element("output", { class: "magnified", "aria-label": "Magnification" });
    const closer = element(
      "div",
      { role: "group", "aria-label": "Zoom", class: "choices zoom" },
      button("−", "Smaller (−)", () => act.closer(1 / 1.5)),
      magnified,
      button("+", "Larger (+)", () => act.closer(1.5)),
      button("fit", "Fit (0)", () => act.fit()),
    );
    const help = button("?", "Keys (?)", () => act.help());

    const whole = element(
      "div",
      { class: "controls" },
      element("div", { class: "line" }, scene.whole, view.whole, seed.whole, modes.whole, pair, help),
      element("div", { class: "line" }, maps.whole),
      element("div", { class: "line" }, step.whole, exposure.whole, range.whole, channel.whole, closer),
    );

    function set(now) {
      scene.set(now.scenes.map((one) => [one.name, one.title]), now.scene.name);
      view.set(now.scene.views.map((one) => [one.name, one.name]), now.shown.name);
      seed.set(now.seeds.map((one) => [String(one), String(one)]), String(now.seed));
      modes.set([now.mode]);
      maps.set(now.maps);
      const names = now.images.map((one) => [one.id, one.name]);
      a.set(names, now.a);
      b.set(names, now.b);
      pair.hidden = now.mode === "side";
      step.input.max = String(Math.max(0, now.steps.length - 1));
      step.input.value = String(now.steps.indexOf(now.step));
      step.input.disabled = now.steps.length < 2;
      play.disabled = now.steps.length < 2;
      step.output.textContent = now.step === null ? "none kept" : `step ${now.step}${took(now)}`;
      step.input.setAttribute("aria-valuetext", step.output.textContent);
      exposure.input.value = String(now.stops);
      exposure.output.textContent = `${now.stops > 0 ? "+" : ""}${numbers.fixed(now.stops, 1)} EV`;
      exposure.input.setAttribute("aria-valuetext", exposure.output.textContent);
      exposure.whole.toggleAttribute("data-hdr", now.shown.hdr);
      exposure.whole.title = now.shown.hdr ? "The truth of this view is brighter than white in places" : "";
      const shown = now.maps.map((name) => errorMaps.MAPS[now.mode === "difference" && name === "colour" ? "signed" : name]);
      range.whole.hidden = !shown.some((map) => map.scaled);
      range.input.value = String(now.scale);
      range.output.textContent = now.scale < 0 ? `÷ ${2 ** -now.scale}` : `× ${2 ** now.scale}`;
      channel.whole.hidden = !shown.some((map) => map.channelled);
      channel.input.value = now.channel;
    }

    function took(now) {
      const seconds = now.images.filter((one) => one.record).map((one) => one.record.seconds);
      if (!seconds.length) return "";
      const [least, most] = [Math.min(...seconds), Math.max(...seconds)].map((v) => v.toFixed(1));
      return ` · ${least === most ? least : `${least}–${most}`} s`;
    }

    const playing = (on) => {
      play.textContent = on ? "❚❚" : "▶";
      play.setAttribute("aria-pressed", String(on));
    };
    const magnify = (scale) => (magnified.textContent = `${Math.round(100 * scale)} %`);
    return { whole, set, playing, magnify };
  }

  return { controls, PLAY };
})();
