// Messages as `harness/viewer/wire.py` writes them: length of the header, header, and 12 bytes for each of its pixels.

const BYTES_PER_PIXEL = 12

/** The arrays of a message: number, depth, colour and opacity of each pixel. */
function pixelsOf(bytes, count) {
  const part = (from, to) => bytes.slice(from * count, to * count).buffer
  return {
    number: new Uint32Array(part(0, 4)),
    depth: new Float32Array(part(4, 8)),
    colour: new Uint8Array(part(8, 11)),
    opacity: new Uint8Array(part(11, 12)),
  }
}

/** Whole messages from the front of `bytes`, and what is left. */
export function split(bytes) {
  const found = []
  let at = 0
  while (at + 4 <= bytes.length) {
    const length = new DataView(bytes.buffer, bytes.byteOffset + at, 4).getUint32(0, true)
    const start = at + 4 + length
    if (start > bytes.length) break
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(at + 4, start)))
    const end = start + BYTES_PER_PIXEL * header.pixels
    if (end > bytes.length) break
    found.push({ header, pixels: header.pixels ? pixelsOf(bytes.subarray(start, end), header.pixels) : null })
    at = end
  }
  return [found, bytes.subarray(at)]
}

/** What a reader should be told as it is. */
export class Told extends Error {}
/** The same question may be answered in a moment. */
export class Busy extends Told {}

/** What the network does; a TypeError of `fetch` or of a body is its way to say that there is none. */
async function reached(promise) {
  try {
    return await promise
  } catch (error) {
    throw error instanceof TypeError ? new Told('The server does not answer: it has ended, or was stopped.') : error
  }
}

async function answer(address, options) {
  const response = await reached(fetch(address, options))
  if (response.ok) return response
  const text = await reached(response.text())
  throw new (response.status === 503 ? Busy : Told)(text.slice(0, 300) || `The server answers ${response.status}.`)
}

export async function json(address) {
  return reached((await answer(address)).json())
}

export async function picture(address) {
  const [found] = split(new Uint8Array(await reached((await answer(address)).arrayBuffer())))
  return found[0]
}

/** Calls `onMessage` for each message of a render as it arrives; ends early where the signal is aborted. */
export async function render(request, signal, onMessage) {
  const response = await answer('/render', {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(request), signal,
  })
  const reader = response.body.getReader()
  let kept = new Uint8Array(0)
  for (;;) {
    const { done, value } = await reached(reader.read())
    if (done) return
    const joined = new Uint8Array(kept.length + value.length)
    joined.set(kept)
    joined.set(value, kept.length)
    const [messages, left] = split(joined)
    kept = left
    for (const message of messages) onMessage(message)
  }
}
