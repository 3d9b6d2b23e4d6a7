// The page: what is chosen, what is asked of the server, and where its answers go.

import { Asking } from './asking.js'
import { closer, farther, handle, KEYS, nearest, reach, within } from './camera.js'
import { decibels, LARGEST_ERROR, made, Panel, ramp, RAMPS } from './panel.js'
import { json, picture, Told } from './stream.js'
import { ofCache, ofPlace } from './words.js'

const $ = id => document.getElementById(id)
const TRUTHS_KEPT = 60

const page = {
  listing: null, scene: null, methods: [], view: null, orbit: null, width: null, mode: 'colour',
  attention: 'foveal', point: { row: 0.5, column: 0.5 }, pointer: null, near: null,
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
    const exact = page.view !== null && truth.filled && truth.key && truth.view === page.view ? truth : null
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

function complain(text) {
  $('alert').textContent = text
  $('alert').hidden = !text
}

// ---- asking

function request() {
  if (!page.methods.length) return null
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
    complain('')
    if (pixels) panel.put(pixels)
    panel.read(header, scored())
    if (header.state !== 'refining') asking.seen(header.method)
  } else if (header.kind === 'loading' && panel) {
    panel.say('state', 'loading …')
    panel.state('loading')
  } else if (header.kind === 'failed' && panel) {
    panel.fail(header.note)
    asking.seen(header.method)
  } else if (header.kind === 'start') {
    for (const one of panels.values()) one.size(header.width, header.height)
    if (!page.near) truth.size(header.width, header.height)
  } else if (header.kind === 'end') {
    $('cache').textContent = ofCache(header.cache)
    $('said').textContent = page.methods.map(name => `${name}: ${panels.get(name).figures.state.textContent}, PSNR ${panels.get(name).figures.psnr.textContent}`).join('; ')
    document.body.dataset.ended = generation
  } else if (header.kind === 'given up') stopped('as many other pages ask; move to ask again')
  else if (header.kind === 'broken') {
    complain(header.note)
    stopped()
  }
  draw()
}

function stopped(why = '') {
  for (const panel of panels.values()) panel.stop(why)
}

/** What is not the server's word or the network's is a mistake of this page, and is said to be one. */
function failed(error) {
  stopped()
  if (!(error instanceof Told)) console.error(error)
  complain(error instanceof Told ? error.message : `This page made a mistake: ${error.message}`)
}

const asking = new Asking(request, receive, failed)
const scored = () => page.view === null ? 'only at a view of the ground truth' : page.scene.missing ? 'no ground truth' : 'only at the views’ own size'

// ---- ground truth

async function showTruth() {
  const scene = page.scene.name, view = page.near?.index
  if (!page.near) {
    truth.key = null
    truth.fail(page.scene.missing || 'No view of the ground truth.')
    truth.say('state', 'none')
    return draw()
  }
  const key = `${scene} ${view}`
  try {
    if (!truths.has(key)) {
      truths.set(key, picture(`/truth?scene=${encodeURIComponent(scene)}&view=${view}`))
      if (truths.size > TRUTHS_KEPT) truths.delete(truths.keys().next().value)
    }
    const { header, pixels } = await truths.get(key)
    if (page.scene.name !== scene || page.near?.index !== view) return
    if (truth.key !== key) {
      truth.size(header.width, header.height)
      truth.put(pixels)
    }
    Object.assign(truth, { key, view })
    truth.state('whole')
    truth.say('state', header.name, page.view === view ? 'exactly here' : `nearest, ${page.near.degrees.toFixed(1)}° away`)
    truth.remark(page.mode === 'depth' && !header.has_depth ? 'This view set has no depth.' : '')
  } catch (error) {
    truths.delete(key)
    truth.key = null
    truth.fail(error.message)
  }
  draw()
}

// ---- moving

function moved() {
  const { scene, view, orbit } = page
  page.near = view === null ? nearest(scene.views, orbit, scene.centre) : { index: view, degrees: 0 }
  $('place').replaceChildren(...ofPlace(page))
  for (const id of ['previous', 'next', 'nearest']) $(id).disabled = !scene.views.length
  showTruth()
  asking.ask()
}

function move(change) {
  page.orbit = within(change(page.orbit), page.reach)
  page.view = null
  moved()
}

function goTo(view) {
  page.view = view
  if (view !== null) {
    const { azimuth, elevation, distance, target } = page.scene.views[view]
    page.orbit = { azimuth, elevation, distance, target }
  } else page.orbit = page.scene.start
  moved()
}

function step(by) {
  const count = page.scene.views.length
  if (count) goTo((page.near.index + by + count) % count)
}

const actions = {
  previous: () => step(-1),
  next: () => step(1),
  nearest: () => page.near && goTo(page.near.index),
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
      asking.ask({ now: true })
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
  const focused = $('panels').contains(document.activeElement) ? document.activeElement : null
  $('panels').replaceChildren(...ordered.map(name => panels.get(name).root), truth.root)
  if (focused) (focused.isConnected ? focused : $('panels').querySelector('canvas')).focus({ preventScroll: true })
  $('panels').classList.toggle('two', panels.size < 2)
  label()
  mark()
}

let chosen = 0

async function choose(name) {
  const number = ++chosen
  asking.drop()
  const scene = await json(`/scene.json?scene=${encodeURIComponent(name)}`)
  if (number !== chosen) return
  asking.drop() // what was asked of the former scene while this one was on its way
  page.scene = scene
  page.reach = reach([scene.start, ...scene.views])
  $('title').textContent = scene.title && scene.title !== scene.name ? `${scene.name} – ${scene.title}` : scene.name
  document.title = `${scene.name} · ${page.listing.run}`
  for (const panel of panels.values()) panel.fail('')
  for (const box of $('methods').querySelectorAll('input')) {
    const cell = scene.cells[box.value]
    box.parentElement.classList.toggle('off', !cell.shown)
    box.parentElement.title = cell.shown ? '' : `${box.value} on ${scene.name}: ${cell.why}`
  }
  const own = scene.width, before = page.width
  const sizes = [Math.max(8, Math.round(own / 2)), own, 2 * own, 4 * own].filter(width => width <= page.listing.largest_width)
  $('size').replaceChildren(...sizes.map(width => {
    const option = made('option', `${width} px${width === own ? ', own' : ''}`)
    option.value = width
    return option
  }))
  page.width = sizes.includes(before) ? before : own
  $('size').value = page.width
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
  const narrow = matchMedia('(max-width: 36rem)'), fold = () => { $('choices').open = !narrow.matches }
  narrow.addEventListener('change', fold)
  fold()
}

function listen() {
  for (const [id, action] of Object.entries(actions)) $(id).addEventListener('click', action)
  $('scene').addEventListener('change', () => choose($('scene').value).catch(error => {
    $('scene').value = page.scene.name
    failed(error)
  }))
  $('attention').addEventListener('change', () => { page.attention = $('attention').value; mark(); asking.ask({ now: true }) })
  $('size').addEventListener('change', () => { page.width = Number($('size').value); asking.ask({ now: true }) })
  $('mode').addEventListener('change', event => {
    page.mode = event.target.value
    label()
    showTruth()
    draw()
  })
  $('methods').addEventListener('change', () => {
    page.methods = [...$('methods').querySelectorAll('input:checked')].map(box => box.value)
    showPanels()
    asking.ask({ now: true })
  })
  const keys = { n: actions.nearest, '[': actions.previous, ']': actions.next, r: actions.reset }
  $('panels').addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey) return
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
  if (document.activeElement === document.body) $('panels').querySelector('canvas').focus({ preventScroll: true })
} catch (error) {
  failed(error)
}
