// A memory of promises that lets go of what was not asked for the longest, once it holds too many bytes.
const kept = (() => {
  // `sizeOf` tells the bytes of a value. A promise that fails is forgotten, so that the next to ask tries again.
  function memory(limit, sizeOf) {
    const found = new Map();
    let held = 0;

    function forget(key) {
      held -= found.get(key).bytes;
      found.delete(key);
    }

    return (key, make) => {
      const known = found.get(key);
      if (known) {
        found.delete(key);
        found.set(key, known);
        return known.promise;
      }
      const entry = { bytes: 0, promise: make() };
      found.set(key, entry);
      entry.promise.then(
        (value) => {
          if (found.get(key) !== entry) return;
          entry.bytes = sizeOf(value);
          held += entry.bytes;
          for (const old of [...found.keys()]) {
            if (held <= limit) break;
            if (old !== key && found.get(old).bytes) forget(old);
          }
        },
        () => found.get(key) === entry && forget(key),
      );
      return entry.promise;
    };
  }

  return { memory };
})();
