// Long computations in slices, so that the page stays responsive.
const chunks = (() => {
  const SLICE = 12;
  // a message returns sooner than a timer, which waits 4 ms
  const pause = () => new Promise((resume) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => resume(port1.close());
    port2.postMessage(null);
  });

  // Runs a generator to its end, with a pause after each slice of milliseconds.
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
