// A cache of promises, limited in bytes; the least recently used values are dropped first.
const kept = (() => {
  // `sizeOf` returns the bytes of a value. A failed promise is dropped, so that the next request tries again.
  function memory(limit, sizeOf) {
    const entries = new Map();

    async function make(key, work) {
      const entry = { bytes: 0, promise: work() };
      entries.set(key, entry);
      try {
        entry.bytes = sizeOf(await entry.promise);
      } catch {
        entries.delete(key);
      }
      let held = [...entries.values()].reduce((sum, { bytes }) => sum + bytes, 0);
      for (const [oldest, { bytes }] of entries) {
        if (held <= limit) return;
        if (oldest === key || bytes === 0) continue;
        entries.delete(oldest);
        held -= bytes;
      }
    }

    return (key, work) => {
      const entry = entries.get(key);
      entries.delete(key);
      if (entry) entries.set(key, entry);
      else make(key, work);
      return entries.get(key).promise;
    };
  }
  return { memory };
})();
