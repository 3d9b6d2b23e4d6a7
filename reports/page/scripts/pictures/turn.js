// A turn around each scene: one slider sets all strips of test views to the same position.
const turn = (() => {
  const PAUSE = 250;

  function start() {
    const block = document.getElementById("turn");
    if (!block) return;
    const frames = [...block.querySelectorAll(".frame")];
    const many = Math.max(...frames.map(({ dataset }) => Number(dataset.views)));
    let playing = 0;

    const place = () => Math.min(Math.max(Math.trunc(Number(state.get("turn.view")) || 0), 0), many - 1);
    const go = (view) => state.set({ "turn.view": view || null }, { soon: true });
    const slider = element("input", { type: "range", min: 0, max: many - 1, "aria-label": "View of the turn", input: () => go(Number(slider.value)) });
    const play = element.button("act", "▶ turn", () => (playing ? stop() : begin()), { "aria-pressed": "false" });

    function begin() {
      playing = setInterval(() => go((place() + 1) % many), PAUSE);
      play.setAttribute("aria-pressed", "true");
    }

    function stop() {
      clearInterval(playing);
      playing = 0;
      play.setAttribute("aria-pressed", "false");
    }

    function draw() {
      slider.value = place();
      for (const frame of frames) {
        const views = Number(frame.dataset.views);
        frame.firstElementChild.style.transform = `translateX(${(-100 * Math.floor((place() * views) / many)) / views}%)`;
      }
    }

    if (many > 1) block.prepend(element("p", { class: "controls" }, slider, play));
    block.classList.add("turning");
    block.closest("details")?.addEventListener("toggle", stop);
    state.on((changed) => changed.has("turn.view") && draw());
    draw();
  }
  return { start };
})();
