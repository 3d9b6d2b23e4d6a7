// One picture with its figures. Text from the server is put in as text, never as markup.

const VIRIDIS = [[68, 1, 84], [72, 40, 120], [62, 74, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [109, 205, 89], [180, 222, 44], [253, 231, 37]]
const INFERNO = [[0, 0, 4], [31, 12, 72], [85, 15, 109], [136, 34, 106], [186, 54, 85], [227, 89, 51], [249, 140, 10], [249, 201, 50], [252, 255, 164]]
const GREY = [[0, 0, 0], [255, 255, 255]]
export const LARGEST_ERROR = 0.3
export const RAMPS = { depth: [...VIRIDIS].reverse(), opacity: GREY, error: INFERNO }

export function ramp(stops, share) {
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1)
  const low = Math.min(Math.floor(at), stops.length - 2)
  return stops[low].map((value, i) => value + (at - low) * (stops[low + 1][i] - value))
}

const seconds = value => value < 0.001 ? '< 1 ms' : value < 1 ? `${(1000 * value).toFixed(0)} ms` : `${value.toFixed(2)} s`
const count = value => value.toLocaleString('en').replaceAll(',', ' ')
export const decibels = value => `${value.toFixed(2)} dB`

export function made(tag, text = '', name = '') {
  const found = document.createElement(tag)
  if (text) found.textContent = text
  if (name) found.className = name
  return found
}

const ROWS = { state: 'State', coarse: 'Coarse', whole: 'Whole', rays: 'Rays', evaluations: 'Evaluations', psnr: 'PSNR, this view', mean: 'PSNR, test mean' }
const TRUTH_ROWS = { state: 'View', views: 'Test views', ceiling: 'PSNR ceiling', floor: 'PSNR floor' }

export class Panel {
  constructor(name, about, truth = false) {
    this.name = name
    this.truth = truth
    this.root = made('figure', '', truth ? 'truth' : 'method')
    this.root.dataset.method = name
    const caption = made('figcaption')
    this.about = made('span', about)
    this.about.title = about
    caption.append(made('strong', name), this.about)
    this.canvas = made('canvas')
    this.canvas.tabIndex = 0
    this.canvas.setAttribute('role', 'application')
    this.bar = made('div', '', 'bar')
    this.over = made('div', '', 'over')
    this.poi = made('div', '', 'poi')
    this.poi.hidden = true
    const box = made('div', '', 'picture')
    box.append(this.canvas, this.poi, this.bar, this.over)
    this.figures = {}
    const list = made('dl')
    for (const [key, title] of Object.entries(truth ? TRUTH_ROWS : ROWS)) {
      this.figures[key] = made('dd', '–')
      this.figures[key].dataset.key = key
      list.append(made('dt', title), this.figures[key])
    }
    this.note = made('p', '', 'note')
    this.note.hidden = true
    this.root.append(caption, box, list, this.note)
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

  put(pixels) {
    this.filled = true
    this.over.textContent = ''
    const { number, depth, colour, opacity } = pixels
    for (let i = 0; i < number.length; i++) {
      const at = number[i]
      this.depth[at] = depth[i]
      this.opacity[at] = opacity[i]
      this.colour[3 * at] = colour[3 * i]
      this.colour[3 * at + 1] = colour[3 * i + 1]
      this.colour[3 * at + 2] = colour[3 * i + 2]
    }
  }

  say(key, text, small = '', kind = '') {
    const cell = this.figures[key]
    cell.textContent = text
    cell.className = kind
    if (small) cell.append(' ', made('small', small))
  }

  remark(text) {
    this.note.textContent = text
    this.note.hidden = !text
  }

  state(state, share = 0) {
    this.root.dataset.state = state
    this.bar.style.width = state === 'refining' ? `${100 * share}%` : '0'
  }

  /** What a frame of the server says besides its pixels. */
  read(frame, scored) {
    this.state(frame.state, frame.share)
    this.remark(frame.note)
    if (frame.state === 'failed') return this.fail(frame.note)
    if (frame.state === 'coarse') {
      this.say('state', 'coarse', `every ${frame.stride} pixels`)
      this.say('coarse', seconds(frame.seconds), `own work ${seconds(frame.work)}`)
      this.say('whole', '…')
      this.say('evaluations', '–')
    } else if (frame.state === 'refining') {
      this.say('state', `refining ${Math.floor(100 * frame.share)} %`)
    } else {
      const cached = frame.level !== null
      if (cached) this.say('state', `cache level ${frame.level}`, ['memory', 'memory', 'disk'][frame.level], 'cached')
      else this.say('state', 'whole', '', 'strong')
      if (cached) this.say('coarse', '–', 'not needed')
      this.say('whole', seconds(frame.seconds), cached ? '' : `own work ${seconds(frame.work)}`)
      this.root.dataset.level = cached ? frame.level : 'none'
    }
    this.say('rays', count(frame.rays))
    if (frame.state !== 'coarse') this.say('evaluations', count(frame.evaluations))
    if (frame.psnr !== null) this.say('psnr', decibels(frame.psnr), frame.state === 'coarse' ? 'coarse' : '', 'strong')
    else if (frame.state !== 'refining') this.say('psnr', '–', scored)
    if (frame.state === 'whole') this.root.dataset.psnr = frame.psnr ?? ''
  }

  fail(why) {
    this.state('failed')
    this.colour.fill(255)
    this.filled = false
    this.over.textContent = why
    const kept = ['mean', 'views', 'ceiling', 'floor']
    for (const key of Object.keys(this.figures)) if (!kept.includes(key)) this.say(key, key === 'state' ? 'not shown' : '–')
    this.remark('')
  }

  /** No more of it will come. */
  stop(why) {
    if (!['loading', 'coarse', 'refining'].includes(this.root.dataset.state)) return
    this.state('stopped')
    this.say('state', 'given up', why)
  }

  /** Depths that were hit: the least and the largest. */
  depths() {
    let least = Infinity, most = -Infinity
    if (this.filled) {
      for (const value of this.depth) {
        if (value > 0 && value < least) least = value
        if (value > most) most = value
      }
    }
    return [least, most]
  }

  draw(mode, [near, far], truth) {
    const context = this.canvas.getContext('2d', { willReadFrequently: true }) // is written by hand alone
    const image = context.createImageData(this.width, this.height)
    const compared = mode === 'error' && truth && !this.truth && truth.width === this.width && truth.height === this.height
    if (mode === 'error' && !this.truth && this.filled && !compared) this.over.textContent = 'Errors are shown at a view of the ground truth.'
    else if (this.filled) this.over.textContent = ''
    const stops = RAMPS[mode]
    for (let at = 0; at < this.depth.length; at++) {
      let rgb = [this.colour[3 * at], this.colour[3 * at + 1], this.colour[3 * at + 2]]
      if (!this.filled) rgb = [255, 255, 255]
      else if (mode === 'opacity') rgb = ramp(stops, this.opacity[at] / 255)
      else if (mode === 'depth') rgb = this.depth[at] > 0 ? ramp(stops, (this.depth[at] - near) / (far - near || 1)) : [255, 255, 255]
      else if (compared) {
        let sum = 0
        for (let i = 0; i < 3; i++) sum += Math.abs(rgb[i] - truth.colour[3 * at + i])
        rgb = ramp(stops, sum / 765 / LARGEST_ERROR)
      } else if (mode === 'error' && !this.truth) rgb = [255, 255, 255]
      image.data.set([rgb[0], rgb[1], rgb[2], 255], 4 * at)
    }
    context.putImageData(image, 0, 0)
  }
}
