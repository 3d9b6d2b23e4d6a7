// Requests to the server: messages as `harness/viewer/wire.py` writes them (length of the header, header, and 12 bytes
// per pixel), and one render at a time, of which the newest request wins.

const BYTES_PER_PIXEL = 12
const PAUSE = 1000

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

/** The complete messages at the front of `bytes`, and the remaining bytes. */
function split(bytes) {
  const messages = []
  let at = 0
  while (at + 4 <= bytes.length) {
    const start = at + 4 + new DataView(bytes.buffer, bytes.byteOffset + at, 4).getUint32(0, true)
    if (start > bytes.length) break
    const header = JSON.parse(new TextDecoder().decode(bytes.subarray(at + 4, start)))
    const end = start + BYTES_PER_PIXEL * header.pixels
    if (end > bytes.length) break
    messages.push({ header, pixels: header.pixels ? pixelsOf(bytes.subarray(start, end), header.pixels) : null })
    at = end
  }
  return [messages, bytes.subarray(at)]
}

/** An error whose message is for the reader. */
export class UserError extends Error {}
/** The server is busy: the same request may succeed in a moment. */
class Busy extends UserError {}

/** Awaits the network; `fetch` and the reading of a body throw a TypeError without a connection. */
async function reached(promise) {
  try {
    return await promise
  } catch (error) {
    throw error instanceof TypeError ? new UserError('The server does not answer: it has ended, or was stopped.') : error
  }
}

async function answer(address, options) {
  const response = await reached(fetch(address, options))
  if (response.ok) return response
  const text = await reached(response.text())
  throw new (response.status === 503 ? Busy : UserError)(text.slice(0, 300) || `The server answers ${response.status}.`)
}

export const json = async address => reached((await answer(address)).json())

export async function picture(address) {
  const [[message]] = split(new Uint8Array(await reached((await answer(address)).arrayBuffer())))
  return message
}

/** Calls `onMessage` for each message of a render as it arrives; ends early if the signal is aborted. */
async function render(request, signal, onMessage) {
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

/** One render at a time: the newest request wins, and each gets at least its coarse frames. */
export class Asking {
  wanted = false
  running = false
  current = null
  coarse = new Set()
  controller = new AbortController()

  /** `make()` returns the present request, or null; `receive(message)` gets its answers, `fail(error)` an error. */
  constructor(make, receive, fail) {
    Object.assign(this, { make, receive, fail })
  }

  ask({ now = false } = {}) {
    this.wanted = true
    if (!this.running) this.pump()
    else if (now || !this.coarse.size) this.abort()
  }

  /** Abandons all requests so far. */
  drop() {
    this.wanted = false
    this.abort()
  }

  abort() {
    this.current = null
    this.controller.abort()
  }

  /** Notes that this method has something to show. */
  seen(method) {
    this.coarse.delete(method)
    if (!this.coarse.size && this.wanted) this.abort()
  }

  async pump() {
    this.running = true
    while (this.wanted) {
      this.wanted = false
      const request = this.current = this.make()
      if (!request) continue
      this.controller = new AbortController()
      this.coarse = new Set(request.methods)
      try {
        // messages of an abandoned request may still arrive
        await render(request, this.controller.signal, message => this.current === request && this.receive(message))
      } catch (error) {
        if (error.name === 'AbortError') continue
        this.fail(error)
        if (error instanceof Busy) {
          await new Promise(resolve => setTimeout(resolve, PAUSE))
          this.wanted ||= this.current === request
        }
      }
    }
    this.running = false
  }
}
