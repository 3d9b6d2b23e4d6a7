// One picture with its figures. Text from the server is inserted as text, never as markup.

const WHITE = [255, 255, 255]
const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]]
const INFERNO = [[0, 0, 4], [31, 12, 72], [85, 15, 109], [136, 34, 106], [186, 54, 85], [227, 89, 51], [249, 140, 10], [249, 201, 50], [252, 255, 164]]
export const LARGEST_ERROR = 0.3
export const RAMPS = { depth: [...VIRIDIS].reverse(), opacity: [[0, 0, 0], WHITE], error: INFERNO }

function ramp(stops, share) {
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1)
  const low = Math.min(Math.floor(at), stops.length - 2)
  return stops[low].map((value, i) => value + (at - low) * (stops[low + 1][i] - value))
}

const seconds = value => value < 0.001 ? '< 1 ms' : value < 1 ? `${(1000 * value).toFixed(0)} ms` : `${value.toFixed(2)} s`
const count = value => value.toLocaleString('en').replaceAll(',', ' ')
export const decibels = value => value == null ? '–' : `${value.toFixed(2)} dB`

/** A new element with properties and children: texts and nodes. */
export function made(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties)
  node.append(...children)
  return node
}

const ROWS = { state: 'State', coarse: 'Coarse', whole: 'Complete', rays: 'Rays', evaluations: 'Evaluations', psnr: 'PSNR, this view', mean: 'PSNR, test mean' }
const TRUTH_ROWS = { state: 'View', views: 'Test views', ceiling: 'PSNR ceiling', floor: 'PSNR floor' }
const LASTING = ['mean', 'views', 'ceiling', 'floor']

export class Panel {
  constructor(name, about, truth = false) {
    this.name = name
    this.truth = truth
    this.canvas = made('canvas', { tabIndex: 0, role: 'application' })
    this.bar = made('div', { className: 'bar' })
    this.over = made('div', { className: 'over' })
    this.poi = made('div', { className: 'poi', hidden: true })
    this.note = made('p', { className: 'note', hidden: true })
    const list = made('dl')
    this.figures = {}
    for (const [key, title] of Object.entries(truth ? TRUTH_ROWS : ROWS)) {
      this.figures[key] = made('dd', {}, '–')
      this.figures[key].dataset.key = key
      list.append(made('dt', {}, title), this.figures[key])
    }
    this.root = made('figure', { className: truth ? 'truth' : 'method' },
      made('figcaption', {}, made('strong', {}, name), made('span', { title: about }, about)),
      made('div', { className: 'picture' }, this.canvas, this.poi, this.bar, this.over), list, this.note)
    this.root.dataset.method = name
    this.size(1, 1)
  }

  size(width, height) {
    if (this.width === width && this.height === height) return
    Object.assign(this, { width, height, filled: false })
    this.canvas.width = width
    this.canvas.height = height
    const pixels = width * height
    this.colour = new Uint8Array(3 * pixels).fill(255)
    this.opacity = new Uint8Array(pixels)
    this.depth = new Float32Array(pixels)
  }

  put({ number, depth, colour, opacity }) {
    this.filled = true
    this.over.textContent = ''
    number.forEach((at, i) => {
      this.depth[at] = depth[i]
      this.opacity[at] = opacity[i]
      this.colour.set(colour.subarray(3 * i, 3 * i + 3), 3 * at)
    })
  }

  say(key, text, small = '', kind = '') {
    const cell = this.figures[key]
    cell.textContent = text
    cell.className = kind
    if (small) cell.append(' ', made('small', {}, small))
  }

  remark(text) {
    this.note.textContent = text
    this.note.hidden = !text
  }

  state(state, share = 0) {
    this.root.dataset.state = state
    this.bar.style.width = state === 'refining' ? `${100 * share}%` : '0'
  }

  /** Shows the header of a frame. */
  read(frame, scored) {
    this.state(frame.state, frame.share)
    this.remark(frame.note)
    if (frame.state === 'failed') return this.fail(frame.note)
    if (frame.state === 'coarse') {
      this.say('state', 'coarse', `every ${frame.stride} pixels`)
      this.say('coarse', seconds(frame.seconds), `own work ${seconds(frame.work)}`)
      this.say('whole', '…')
    } else if (frame.state === 'refining') {
      this.say('state', `refining ${Math.floor(100 * frame.share)} %`)
    } else {
      const cached = frame.cached !== null
      if (cached) this.say('state', 'view cache', frame.cached, 'cached')
      else this.say('state', 'complete', '', 'strong')
      if (cached) this.say('coarse', '–', 'not needed')
      this.say('whole', seconds(frame.seconds), cached ? '' : `own work ${seconds(frame.work)}`)
      this.root.dataset.cached = frame.cached ?? 'none'
      this.root.dataset.psnr = frame.psnr ?? ''
    }
    this.say('rays', count(frame.rays))
    this.say('evaluations', frame.state === 'coarse' ? '–' : count(frame.evaluations))
    if (frame.psnr !== null) this.say('psnr', decibels(frame.psnr), frame.state === 'coarse' ? 'coarse' : '', 'strong')
    else if (frame.state !== 'refining') this.say('psnr', '–', scored)
  }

  fail(why) {
    this.state('failed')
    this.filled = false
    this.over.textContent = why
    for (const key of Object.keys(this.figures)) if (!LASTING.includes(key)) this.say(key, key === 'state' ? 'not shown' : '–')
    this.remark('')
  }

  /** Marks an unfinished picture as cancelled. */
  stop(why) {
    if (!['loading', 'coarse', 'refining'].includes(this.root.dataset.state)) return
    this.state('stopped')
    this.say('state', 'cancelled', why)
  }

  /** The minimum and maximum of the depths that were hit. */
  depths() {
    let least = Infinity, most = -Infinity
    for (const value of this.filled ? this.depth : []) {
      if (value > 0 && value < least) least = value
      if (value > most) most = value
    }
    return [least, most]
  }

  draw(mode, [near, far], truth) {
    const isError = mode === 'error' && !this.truth
    const compared = isError && truth?.width === this.width && truth.height === this.height
    if (this.filled) this.over.textContent = isError && !compared ? 'Errors are shown at a view of the ground truth.' : ''
    const stops = RAMPS[mode]
    const colour = at => this.colour.subarray(3 * at, 3 * at + 3)
    const error = at => colour(at).reduce((sum, value, i) => sum + Math.abs(value - truth.colour[3 * at + i]), 0) / 765
    let shade = colour
    if (!this.filled || (isError && !compared)) shade = () => WHITE
    else if (isError) shade = at => ramp(stops, error(at) / LARGEST_ERROR)
    else if (mode === 'opacity') shade = at => ramp(stops, this.opacity[at] / 255)
    else if (mode === 'depth') shade = at => this.depth[at] > 0 ? ramp(stops, (this.depth[at] - near) / (far - near || 1)) : WHITE
    const context = this.canvas.getContext('2d', { willReadFrequently: true }) // stays in memory: only putImageData draws
    const image = context.createImageData(this.width, this.height)
    image.data.fill(255)
    for (let at = 0; at < this.depth.length; at++) image.data.set(shade(at), 4 * at)
    context.putImageData(image, 0, 0)
  }
}
