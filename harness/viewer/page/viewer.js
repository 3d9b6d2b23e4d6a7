// The page: what is chosen, what is asked of the server, and where its answers go.

import { closer, farther, handle, KEYS } from './camera.js'
import { decibels, LARGEST_ERROR, made, Panel, ramp, RAMPS } from './panel.js'
import { json, picture, render } from './stream.js'

const $ = id => document.getElementById(id)
const TRUTHS_KEPT = 60

const page = {
  listing: null, scene: null, methods: [], view: null, orbit: null, width: null, mode: 'colour',
  attention: 'foveal', point: { row: 0.5, column: 0.5 }, pointer: null, nearest: null,
}
const panels = new Map()
const truth = new Panel('ground truth', '', true)
const truths = new Map()
const client = crypto.getRandomValues(new Uint32Array(4)).join('-')
let generation = 0
let drawing = false

function draw() {
  if (drawing) return
  drawing = true
  requestAnimationFrame(() => {
    drawing = false
    const all = [...panels.values(), truth]
    const ranges = all.map(panel => panel.depths())
    const near = Math.min(...ranges.map(range => range[0])), far = Math.max(...ranges.map(range => range[1]))
    const known = Number.isFinite(near) && Number.isFinite(far)
    const exact = page.view !== null && truth.filled && truth.shown === page.view ? truth : null
    for (const panel of all) panel.draw(page.mode, known ? [near, far] : [0, 1], exact)
    const scale = { depth: known ? [`${near.toFixed(2)} near`, `${far.toFixed(2)} far, scene units`] : null, opacity: ['0', '1'], error: ['0', `${LARGEST_ERROR} or more`] }[page.mode]
    $('scale').hidden = !scale
    if (!scale) return
    $('least').textContent = scale[0]
    $('most').textContent = scale[1]
    const context = $('ramp').getContext('2d'), image = context.createImageData(128, 1)
    for (let i = 0; i < 128; i++) image.data.set([...ramp(RAMPS[page.mode], i / 127), 255], 4 * i)
    context.putImageData(image, 0, 0)
  })
}

function alert(text) {
  $('alert').textContent = text
  $('alert').hidden = !text
}

// ---- asking: one render at a time, the newest wish wins, and each gets at least its coarse frames

const asking = { wanted: false, running: false, coarse: new Set(), controller: null }

function ask({ now = false } = {}) {
  asking.wanted = true
  if (asking.running) {
    if (now || !asking.coarse.size) asking.controller.abort()
    return
  }
  pump()
}

async function pump() {
  asking.running = true
  while (asking.wanted) {
    asking.wanted = false
    asking.controller = new AbortController()
    asking.coarse = new Set(page.methods)
    try {
      if (page.methods.length) await render(request(), asking.controller.signal, receive)
      else await showTruth(page.view ?? page.nearest)
    } catch (error) {
      if (error.name !== 'AbortError') {
        alert(error instanceof TypeError ? 'The server does not answer: it has ended, or was stopped.' : error.message)
        break
      }
    }
  }
  asking.running = false
}

function request() {
  for (const panel of panels.values()) delete panel.root.dataset.level
  const { row, column } = (page.attention === 'point' && page.pointer) || page.point
  return {
    client, generation: ++generation, scene: page.scene.name, methods: page.methods,
    place: page.view === null ? page.orbit : { view: page.view },
    attention: { kind: page.attention, row, column }, width: page.width,
  }
}

function receive({ header, pixels }) {
  const panel = panels.get(header.method)
  if (header.kind === 'frame' && panel) {
    alert('')
    if (pixels) panel.put(pixels)
    panel.read(header, scored())
    if (header.state !== 'refining') coarseOf(header.method)
  } else if (header.kind === 'loading' && panel) {
    panel.say('state', 'loading …')
    panel.state('loading')
  } else if (header.kind === 'failed' && panel) {
    panel.fail(header.note)
    coarseOf(header.method)
  } else if (header.kind === 'start') {
    for (const one of panels.values()) one.size(header.width, header.height)
    if (!panels.size || header.nearest === undefined) truth.size(header.width, header.height)
    page.nearest = header.nearest ?? null
    page.degrees = header.degrees ?? null
    whereWords()
    showTruth(page.nearest)
  } else if (header.kind === 'end') {
    cacheWords(header.cache)
    $('said').textContent = page.methods.map(name => `${name}: ${panels.get(name).figures.state.textContent}, PSNR ${panels.get(name).figures.psnr.textContent}`).join('; ')
    document.body.dataset.ended = header.generation ?? generation
  } else if (header.kind === 'broken') alert(header.note)
  draw()
}

function coarseOf(method) {
  asking.coarse.delete(method)
  if (!asking.coarse.size && asking.wanted) asking.controller.abort()
}

const scored = () => page.view === null ? 'only at a view of the ground truth' : page.scene.missing ? 'no ground truth' : 'only at the views’ own size'

// ---- ground truth

async function showTruth(view) {
  if (view === null || page.scene.missing) {
    truth.fail(page.scene.missing || 'No view of the ground truth.')
    truth.say('state', 'none')
    return draw()
  }
  const scene = page.scene.name, key = `${scene} ${view}`
  try {
    if (!truths.has(key)) {
      truths.set(key, picture(`/truth?scene=${encodeURIComponent(scene)}&view=${view}`))
      if (truths.size > TRUTHS_KEPT) truths.delete(truths.keys().next().value)
    }
    const { header, pixels } = await truths.get(key)
    if (page.scene.name !== scene || (page.view ?? page.nearest) !== view) return
    truth.size(header.width, header.height)
    truth.put(pixels)
    truth.shown = view
    truth.state('whole')
    truth.say('state', header.name, page.view === view ? 'exactly here' : `nearest, ${page.degrees.toFixed(1)}° away`)
    truth.remark(page.mode === 'depth' && !header.has_depth ? 'This view set has no depth.' : '')
  } catch (error) {
    truths.delete(key)
    truth.fail(error.message)
  }
  draw()
}

// ---- words

function whereWords() {
  const { scene, view, nearest, orbit } = page, place = $('place')
  const degrees = angle => `${(angle * 180 / Math.PI).toFixed(1)}°`
  const azimuth = ((orbit.azimuth + Math.PI) % (2 * Math.PI)) - Math.PI
  const pose = `azimuth ${degrees(azimuth)}, elevation ${degrees(orbit.elevation)}, distance ${orbit.distance.toFixed(2)}`
  place.textContent = ''
  if (view !== null) place.append('At ', made('b', `test view ${view + 1} of ${scene.views.length}`), ` · ${pose}`)
  else if (nearest !== null && page.degrees !== null) place.append('Free', ` · nearest: test view ${nearest + 1} of ${scene.views.length}, ${page.degrees.toFixed(1)}° away · ${pose}`)
  else place.append('Free', ` · ${pose}`)
  for (const id of ['previous', 'next', 'nearest']) $(id).disabled = !scene.views.length
}

function cacheWords(cache) {
  const cached = ['level 0', 'level 1', 'level 2'].map(level => cache.sources[level] ?? 0)
  const hits = cached.reduce((sum, value) => sum + value, 0), all = hits + (cache.sources.rendered ?? 0)
  const size = bytes => `${(bytes / 2 ** 20).toFixed(1)} MiB`
  const parts = [`View cache: ${hits} of ${all} pictures (${all ? Math.round(100 * hits / all) : 0} %) served from it`]
  if (hits) parts.push(`memory ${cached[0] + cached[1]}, disk ${cached[2]}`)
  parts.push(`holds ${size(cache.memory_bytes)} in memory${cache.memory_alone ? '' : `, ${size(cache.disk_bytes)} on disk`}`)
  if (cache.memory_alone) parts.push(`nothing is kept on disk: ${cache.memory_alone}`)
  if (cache.failed_writes) parts.push(`${cache.failed_writes} writes failed: ${cache.last_failure}`)
  if (cache.damaged) parts.push(`${cache.damaged} damaged files dropped`)
  $('cache').textContent = parts.join(' · ')
}

// ---- moving

function move(change) {
  page.orbit = change(page.orbit)
  page.view = null
  whereWords()
  ask()
}

function goTo(view) {
  page.view = view
  if (view !== null) {
    const { azimuth, elevation, distance, target } = page.scene.views[view]
    page.orbit = { azimuth, elevation, distance, target }
    page.nearest = view
    page.degrees = 0
  } else page.orbit = page.scene.start
  whereWords()
  ask()
}

function step(by) {
  const count = page.scene.views.length
  if (count) goTo((((page.view ?? page.nearest ?? 0) + by) % count + count) % count)
}

const actions = {
  previous: () => step(-1),
  next: () => step(1),
  nearest: () => page.nearest !== null && goTo(page.nearest),
  reset: () => goTo(page.scene.views.length ? 0 : null),
  closer: () => move(closer),
  farther: () => move(farther),
}

function mark() {
  const shown = page.attention === 'foveal' || page.attention === 'point'
  for (const panel of panels.values()) {
    panel.poi.hidden = !shown
    panel.poi.style.left = `${100 * page.point.column}%`
    panel.poi.style.top = `${100 * page.point.row}%`
  }
}

function movable(panel) {
  handle(panel.canvas, {
    move,
    at: (row, column) => { page.pointer = { row, column } },
    chosen: (row, column) => {
      page.point = page.pointer = { row, column }
      mark()
      ask({ now: true })
    },
  })
}

// ---- choosing

function label() {
  for (const panel of [...panels.values(), truth]) panel.canvas.setAttribute('aria-label', `${panel.name}, ${page.scene.name}, ${page.mode}. Drag or use the arrow keys to orbit.`)
}

function showPanels() {
  const about = Object.fromEntries(page.listing.methods.map(method => [method.name, method.about]))
  for (const name of [...panels.keys()]) if (!page.methods.includes(name)) panels.delete(name)
  for (const name of page.methods) {
    if (!panels.has(name)) {
      panels.set(name, new Panel(name, about[name]))
      movable(panels.get(name))
    }
    const cell = page.scene.cells[name], trained = `${cell.weights} weights, ${cell.train_seconds?.toFixed(0)} s of training`
    panels.get(name).say('mean', cell.psnr == null ? '–' : decibels(cell.psnr))
    panels.get(name).figures.mean.title = trained
  }
  const ordered = page.listing.methods.map(method => method.name).filter(name => panels.has(name))
  $('panels').replaceChildren(...ordered.map(name => panels.get(name).root), truth.root)
  $('panels').classList.toggle('two', panels.size < 2)
  label()
  mark()
}

async function choose(name) {
  asking.controller?.abort()
  const scene = await json(`/scene.json?scene=${encodeURIComponent(name)}`)
  page.scene = scene
  $('title').textContent = scene.title && scene.title !== scene.name ? `${scene.name} – ${scene.title}` : scene.name
  document.title = `${scene.name} · ${page.listing.run}`
  for (const panel of panels.values()) panel.fail('')
  for (const box of $('methods').querySelectorAll('input')) {
    const cell = scene.cells[box.value]
    box.parentElement.classList.toggle('off', !cell.shown)
    box.parentElement.title = cell.shown ? '' : `${box.value} on ${scene.name}: ${cell.why}`
  }
  const own = scene.width, chosen = page.width
  const sizes = [Math.max(8, Math.round(own / 2)), own, 2 * own, 4 * own].filter(width => width <= page.listing.largest_width)
  $('size').replaceChildren(...sizes.map(width => {
    const option = made('option', `${width} px${width === own ? ', own' : ''}`)
    option.value = width
    return option
  }))
  page.width = sizes.includes(chosen) ? chosen : own
  $('size').value = page.width
  page.nearest = page.degrees = null
  truth.say('views', scene.views.length || '–')
  truth.say('ceiling', scene.psnr_ceiling == null ? '–' : decibels(scene.psnr_ceiling), 'by its own noise')
  truth.say('floor', scene.psnr_floor == null ? '–' : decibels(scene.psnr_floor), 'nearest training view')
  showPanels()
  goTo(scene.views.length ? 0 : null)
}

function fill() {
  const { listing } = page
  $('run').textContent = `${listing.run} · ${listing.profile} profile · seed ${listing.seed}`
  for (const { name } of listing.scenes) $('scene').append(made('option', name))
  for (const { name, about } of listing.attentions) {
    const option = made('option', about)
    option.value = name
    $('attention').append(option)
  }
  const picks = made('div', '', 'picks')
  for (const { name, about } of listing.methods) {
    const box = made('input'), line = made('label')
    box.type = 'checkbox'
    box.value = name
    box.checked = page.methods.includes(name)
    line.append(box, name)
    line.title = about
    picks.append(line)
  }
  $('methods').append(picks)
  $('scene').value = listing.first.scene
}

function listen() {
  for (const [id, action] of Object.entries(actions)) $(id).addEventListener('click', action)
  $('scene').addEventListener('change', () => choose($('scene').value).catch(error => alert(error.message)))
  $('attention').addEventListener('change', () => { page.attention = $('attention').value; mark(); ask({ now: true }) })
  $('size').addEventListener('change', () => { page.width = Number($('size').value); ask({ now: true }) })
  $('mode').addEventListener('change', event => {
    page.mode = event.target.value
    label()
    showTruth(page.view ?? page.nearest)
    draw()
  })
  $('methods').addEventListener('change', () => {
    page.methods = [...$('methods').querySelectorAll('input:checked')].map(box => box.value)
    showPanels()
    ask({ now: true })
  })
  const keys = { n: actions.nearest, '[': actions.previous, ']': actions.next, r: actions.reset }
  addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest('select, input[type=radio]')) return
    if (KEYS[event.key]) move(KEYS[event.key])
    else if (keys[event.key]) keys[event.key]()
    else return
    event.preventDefault()
  })
}

try {
  page.listing = await json('/run.json')
  page.methods = page.listing.first.methods
  fill()
  movable(truth)
  await choose(page.listing.first.scene)
  listen()
} catch (error) {
  alert(error.message)
}
