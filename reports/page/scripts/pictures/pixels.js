// The page's stored pictures → numbers. A picture is named by a REF of the page's data: channels, bits, low, high, id.
const pixels = (() => {
  const remember = kept.memory(192e6, (raw) => raw.byteLength);
  const tables = new WeakMap();
  const files = new Map();
  const fromFiles = new Map();

  globalThis.reportPictures = (texts) => {
    for (const [id, text] of Object.entries(texts)) fromFiles.set(id, text);
  };

  function loaded(file) {
    if (!files.has(file)) {
      const promise = new Promise((resolve, reject) => {
        const tag = document.createElement("script");
        tag.src = file;
        tag.onload = resolve;
        tag.onerror = () => reject(new Error(`the file ${file} beside the page cannot be read`));
        document.head.append(tag);
      });
      files.set(file, promise);
      promise.catch(() => files.delete(file));
    }
    return files.get(file);
  }

  async function text(ref) {
    if (ref.file) await loaded(ref.file);
    const packed = ref.file ? fromFiles.get(ref.id) : document.getElementById(ref.id)?.textContent.trim();
    if (!packed) throw new Error(`no pixels ${ref.id} in ${ref.file ?? "the page"}`);
    return packed;
  }

  async function inflated(base64, size) {
    const packed = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    if (bytes.length !== size) throw new Error(`${bytes.length} bytes of pixels instead of ${size}`);
    return bytes;
  }

  // Undoes the delta coding of a plane, in place: from the left neighbour, in the first column from the pixel above.
  function summed(plane, width) {
    for (let place = 1; place < plane.length; place += 1) {
      plane[place] += plane[place % width === 0 ? place - width : place - 1];
    }
  }

  async function decoded(ref, width, height) {
    const area = width * height;
    const wide = ref.bits === 16;
    const bytes = await inflated(await text(ref), area * ref.channels * (wide ? 2 : 1));
    for (let start = 0; start < bytes.length; start += area) summed(bytes.subarray(start, start + area), width);
    if (!wide) return bytes;
    const values = new Uint16Array(area * ref.channels);
    for (let place = 0; place < values.length; place += 1) {
      const high = place + Math.floor(place / area) * area;
      values[place] = bytes[high] * 256 + bytes[high + area];
    }
    return values;
  }

  // The raw numbers of a picture, planar, as Uint8Array or Uint16Array; rejects with a sentence.
  function raw(ref, width, height) {
    return remember(`${ref.file ?? ""} ${ref.id} ${ref.bits} ${width}`, async () => {
      try {
        return await decoded(ref, width, height);
      } catch (error) {
        throw new Error(`This picture cannot be shown: ${error.message || "its bytes are damaged"}.`);
      }
    });
  }

  // The meanings of all 256 or 65536 raw numbers of a REF.
  function meanings(ref) {
    if (!tables.has(ref)) {
      const most = 2 ** ref.bits - 1;
      tables.set(ref, Float64Array.from({ length: most + 1 }, (_, number) => {
        const value = ref.low + (number / most) * (ref.high - ref.low);
        return ref.log ? Math.max(0, Math.exp(value) - 1e-4) : value;
      }));
    }
    return tables.get(ref);
  }

  return { raw, meanings };
})();
