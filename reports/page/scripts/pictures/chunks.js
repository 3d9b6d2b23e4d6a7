// Long computations in slices, so that the page goes on answering.
const chunks = (() => {
  const SLICE = 12;
  const waiting = [];
  const channel = new MessageChannel();
  channel.port1.onmessage = () => waiting.shift()();
  const pause = () =>
    new Promise((resume) => {
      waiting.push(resume);
      channel.port2.postMessage(null);
    });

  // Runs a generator to its end, never for longer than a slice of milliseconds at a time.
  async function run(work) {
    for (;;) {
      const end = performance.now() + SLICE;
      do {
        const { done, value } = work.next();
        if (done) return value;
      } while (performance.now() < end);
      await pause();
    }
  }

  return { run };
})();
