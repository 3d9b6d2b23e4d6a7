// The page: its state, its requests to the server, and their answers.

import { closer, farther, handle, KEYS, nearest, reach, within } from './camera.js'
import { decibels, LARGEST_ERROR, made, Panel, RAMPS } from './panel.js'
import { Asking, json, picture, UserError } from './stream.js'

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
const every = () => [...panels.values(), truth]

function draw() {
  if (drawing) return
  drawing = true
  requestAnimationFrame(() => {
    drawing = false
    const ranges = every().map(panel => panel.depths())
    const near = Math.min(...ranges.map(([least]) => least)), far = Math.max(...ranges.map(([, most]) => most))
    const exact = page.view !== null && truth.filled && truth.key && truth.view === page.view ? truth : null
    const isKnown = Number.isFinite(near) && Number.isFinite(far)
    for (const panel of every()) panel.draw(page.mode, isKnown ? [near, far] : [0, 1], exact)
    const ends = {
      depth: isKnown ? [`${near.toFixed(2)} near`, `${far.toFixed(2)} far, scene units`] : null,
      opacity: ['0', '1'], error: ['0', `${LARGEST_ERROR} or more`],
    }[page.mode]
    $('scale').hidden = !ends
    if (!ends) return
    $('least').textContent = ends[0]
    $('most').textContent = ends[1]
    $('ramp').style.background = `linear-gradient(90deg, ${RAMPS[page.mode].map(rgb => `rgb(${rgb})`)})`
  })
}

function complain(text) {
  $('alert').textContent = text
  $('alert').hidden = !text
}

// ---- asking

function request() {
  if (!page.methods.length) return null
  for (const panel of panels.values()) delete panel.root.dataset.cached
  const { row, column } = (page.attention === 'point' && page.pointer) || page.point
  return {
    client, generation: ++generation, scene: page.scene.name, methods: page.methods,
    place: page.view === null ? page.orbit : { view: page.view },
    attention: { kind: page.attention, row, column }, width: page.width,
  }
}

const receivers = {
  frame(header, pixels, panel) {
    complain('')
    if (pixels) panel.put(pixels)
    panel.read(header, page.view === null ? 'only at a view of the ground truth' : page.scene.missing ? 'no ground truth' : 'only at the views’ own size')
    if (header.state !== 'refining') asking.seen(header.method)
  },
  loading(header, _, panel) {
    panel.say('state', 'loading …')
    panel.state('loading')
  },
  failed(header, _, panel) {
    panel.fail(header.note)
    asking.seen(header.method)
  },
  start({ width, height }) {
    for (const panel of page.near ? panels.values() : every()) panel.size(width, height)
  },
  end({ cache }) {
    $('cache').textContent = ofCache(cache)
    $('said').textContent = [...panels].map(([name, { figures }]) => `${name}: ${figures.state.textContent}, PSNR ${figures.psnr.textContent}`).join('; ')
    document.body.dataset.ended = generation
  },
  'given up': () => stopped('too many other pages are open; move to ask again'),
  broken({ note }) {
    complain(note)
    stopped()
  },
}

function receive({ header, pixels }) {
  const panel = panels.get(header.method)
  if (header.method === undefined || panel) receivers[header.kind](header, pixels, panel)
  draw()
}

function stopped(why = '') {
  for (const panel of panels.values()) panel.stop(why)
}

/** Shows an error; any other than a `UserError` is a bug of this page. */
function failed(error) {
  stopped()
  const isBug = !(error instanceof UserError)
  if (isBug) console.error(error)
  complain(isBug ? `This page has a bug: ${error.message}` : error.message)
}

const asking = new Asking(request, receive, failed)

function ofCache({ sources, memory_alone: why }) {
  const { memory = 0, disk = 0, rendered = 0 } = sources
  const hits = memory + disk, all = hits + rendered
  const share = `${hits} of ${all} pictures (${all ? Math.round(100 * hits / all) : 0} %) served from it`
  return [
    `View cache, all pages together since the server began: ${share}`,
    hits && `memory ${memory}, disk ${disk}`, why && `nothing is kept on disk: ${why}`,
  ].filter(Boolean).join(' · ')
}

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

/** Nodes that describe the camera, and its angle from the nearest view of the ground truth. */
function place({ scene, view, near, orbit }) {
  const degrees = angle => `${(angle * 180 / Math.PI).toFixed(1)}°`
  const azimuth = ((orbit.azimuth + Math.PI) % (2 * Math.PI)) - Math.PI
  const pose = `azimuth ${degrees(azimuth)}, elevation ${degrees(orbit.elevation)}, distance ${orbit.distance.toFixed(2)}`
  if (view !== null) return ['At ', made('b', {}, `test view ${view + 1} of ${scene.views.length}`), ` · ${pose}`]
  return [near ? `Free · nearest: test view ${near.index + 1} of ${scene.views.length}, ${near.degrees.toFixed(1)}° away · ${pose}` : `Free · ${pose}`]
}

function moved() {
  const { scene, view, orbit } = page
  page.near = view === null ? nearest(scene.views, orbit, scene.centre) : { index: view, degrees: 0 }
  $('place').replaceChildren(...place(page))
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
  const { azimuth, elevation, distance, target } = view === null ? page.scene.start : page.scene.views[view]
  page.view = view
  page.orbit = { azimuth, elevation, distance, target }
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
  for (const { poi } of panels.values()) {
    poi.hidden = !shown
    poi.style.left = `${100 * page.point.column}%`
    poi.style.top = `${100 * page.point.row}%`
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
  for (const { canvas, name } of every()) canvas.ariaLabel = `${name}, ${page.scene.name}, ${page.mode}. Drag or use the arrow keys to orbit.`
}

function showPanels() {
  const shown = page.listing.methods.filter(({ name }) => page.methods.includes(name))
  for (const name of [...panels.keys()]) if (!page.methods.includes(name)) panels.delete(name)
  for (const { name, about } of shown) {
    if (!panels.has(name)) {
      panels.set(name, new Panel(name, about))
      movable(panels.get(name))
    }
    const cell = page.scene.cells[name], panel = panels.get(name)
    panel.say('mean', decibels(cell.psnr))
    panel.figures.mean.title = cell.shown ? `${cell.weights} weights, ${cell.train_seconds.toFixed(0)} s of training` : cell.why
  }
  const focused = $('panels').contains(document.activeElement) ? document.activeElement : null
  $('panels').replaceChildren(...shown.map(({ name }) => panels.get(name).root), truth.root)
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
  asking.drop() // requests of the former scene while this one was loading
  page.scene = scene
  page.reach = reach([scene.start, ...scene.views])
  $('title').textContent = scene.title && scene.title !== scene.name ? `${scene.name} – ${scene.title}` : scene.name
  document.title = `${scene.name} · ${page.listing.run}`
  for (const panel of panels.values()) panel.fail('')
  for (const box of $('methods').querySelectorAll('input')) {
    const { shown, why } = scene.cells[box.value]
    box.parentElement.classList.toggle('off', !shown)
    box.parentElement.title = shown ? '' : `${box.value} on ${scene.name}: ${why}`
  }
  const own = scene.width
  const sizes = [Math.max(8, Math.round(own / 2)), own, 2 * own, 4 * own].filter(width => width <= page.listing.largest_width)
  if (!sizes.includes(page.width)) page.width = own
  options('size', sizes.map(width => [width, `${width} px${width === own ? ', own' : ''}`]), page.width)
  truth.say('views', scene.views.length || '–')
  truth.say('ceiling', decibels(scene.psnr_ceiling), scene.psnr_ceiling == null ? '' : 'by its own noise')
  truth.say('floor', decibels(scene.psnr_floor), scene.psnr_floor == null ? '' : 'nearest training view')
  showPanels()
  goTo(scene.views.length ? 0 : null)
}

function options(id, entries, value) {
  $(id).replaceChildren(...entries.map(([value, text]) => made('option', { value }, text)))
  $(id).value = value
}

function fill({ run, profile, seed, scenes, attentions, methods, first }) {
  $('run').textContent = `${run} · ${profile} profile · seed ${seed}`
  options('scene', scenes.map(({ name }) => [name, name]), first.scene)
  options('attention', attentions.map(({ name, about }) => [name, about]), page.attention)
  $('methods').append(made('div', { className: 'picks' }, ...methods.map(({ name, about }) =>
    made('label', { title: about }, made('input', { type: 'checkbox', value: name, checked: page.methods.includes(name) }), name))))
  const narrow = matchMedia('(max-width: 36rem)'), fold = () => { $('choices').open = !narrow.matches }
  narrow.addEventListener('change', fold)
  fold()
}

function listen() {
  const asks = change => event => {
    change(event.target.value)
    asking.ask({ now: true })
  }
  for (const [id, action] of Object.entries(actions)) $(id).addEventListener('click', action)
  $('scene').addEventListener('change', () => choose($('scene').value).catch(error => {
    $('scene').value = page.scene.name
    failed(error)
  }))
  $('attention').addEventListener('change', asks(value => { page.attention = value; mark() }))
  $('size').addEventListener('change', asks(value => { page.width = Number(value) }))
  $('methods').addEventListener('change', asks(() => {
    page.methods = [...$('methods').querySelectorAll('input:checked')].map(box => box.value)
    showPanels()
  }))
  $('mode').addEventListener('change', event => {
    page.mode = event.target.value
    label()
    showTruth()
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
  fill(page.listing)
  movable(truth)
  await choose(page.listing.first.scene)
  listen()
  if (document.activeElement === document.body) $('panels').querySelector('canvas').focus({ preventScroll: true })
} catch (error) {
  failed(error)
}
