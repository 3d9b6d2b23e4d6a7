// A memory of promises that lets go of what was not asked for the longest, once it holds too many bytes.
const kept = (() => {
  // `sizeOf` tells the bytes of a value. A promise that fails is forgotten, so that the next to ask tries again.
  function memory(limit, sizeOf) {
    const entries = new Map();

    function tidy(latest) {
      let held = [...entries.values()].reduce((sum, { bytes }) => sum + bytes, 0);
      for (const [key, { bytes }] of entries) {
        if (held <= limit) return;
        if (key === latest || bytes === 0) continue;
        entries.delete(key);
        held -= bytes;
      }
    }

    return (key, make) => {
      const entry = entries.get(key) ?? { bytes: 0, promise: make() };
      entries.delete(key);
      entries.set(key, entry);
      entry.promise.then(
        (value) => {
          entry.bytes = sizeOf(value);
          tidy(key);
        },
        () => entries.get(key) === entry && entries.delete(key),
      );
      return entry.promise;
    };
  }

  return { memory };
})();
