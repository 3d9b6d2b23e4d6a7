// The camera: an orbit about a target, z up, angles in radians; how a user moves it, and the nearest known view.

const STEEPEST = 1.55
const RADIANS_PER_PIXEL = 0.008
const STEP = Math.PI / 36
const ZOOM = 1.12
const REACH = 16 // times nearer and farther than the known cameras

const clamp = (value, least, most) => Math.min(Math.max(value, least), most)

export function turned(orbit, azimuth, elevation) {
  const full = 2 * Math.PI
  return {
    ...orbit,
    azimuth: (((orbit.azimuth + azimuth) % full) + full) % full,
    elevation: clamp(orbit.elevation + elevation, -STEEPEST, STEEPEST),
  }
}

export const zoomed = (orbit, factor) => ({ ...orbit, distance: orbit.distance * factor })

/** The limits of the distance, from the orbits of a scene in any unit. */
export function reach(orbits) {
  const distances = orbits.map(orbit => orbit.distance)
  return [Math.min(...distances) / REACH, Math.max(...distances) * REACH]
}

export const within = (orbit, [least, most]) => ({ ...orbit, distance: clamp(orbit.distance, least, most) })

/** The vector from `centre` to the camera. */
function direction({ azimuth, elevation, distance, target }, centre) {
  const flat = distance * Math.cos(elevation)
  const arm = [flat * Math.cos(azimuth), flat * Math.sin(azimuth), distance * Math.sin(elevation)]
  return arm.map((value, i) => value + target[i] - centre[i])
}

/** The view whose direction from `centre` is nearest to that of `orbit`, and the angle between both; null without views. */
export function nearest(views, orbit, centre) {
  const [x, y, z] = direction(orbit, centre)
  let best = null
  views.forEach((view, index) => {
    const [u, v, w] = direction(view, centre)
    const degrees = Math.atan2(Math.hypot(y * w - z * v, z * u - x * w, x * v - y * u), x * u + y * v + z * w) * 180 / Math.PI
    if (!best || degrees < best.degrees) best = { index, degrees }
  })
  return best
}

export const KEYS = {
  ArrowLeft: orbit => turned(orbit, -STEP, 0),
  ArrowRight: orbit => turned(orbit, STEP, 0),
  ArrowUp: orbit => turned(orbit, 0, STEP),
  ArrowDown: orbit => turned(orbit, 0, -STEP),
  '+': orbit => zoomed(orbit, 1 / ZOOM),
  '=': orbit => zoomed(orbit, 1 / ZOOM),
  '-': orbit => zoomed(orbit, ZOOM),
}
export const closer = KEYS['+']
export const farther = KEYS['-']

/** Calls `move(change)` with a function of the orbit, `at(row, column)` with the pointer's place, and `chosen` on a click. */
export function handle(canvas, { move, at, chosen }) {
  const pointers = new Map()
  let moved = 0
  const place = event => {
    const box = canvas.getBoundingClientRect()
    return [clamp((event.clientY - box.top) / box.height, 0, 1), clamp((event.clientX - box.left) / box.width, 0, 1)]
  }
  const spread = () => {
    const [first, second] = [...pointers.values()]
    return Math.hypot(first.x - second.x, first.y - second.y)
  }
  canvas.addEventListener('pointerdown', event => {
    if (event.button) return
    canvas.setPointerCapture(event.pointerId)
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY })
    if (pointers.size === 1) moved = 0
  })
  canvas.addEventListener('pointermove', event => {
    at(...place(event))
    const before = pointers.get(event.pointerId)
    if (!before) return
    const distance = pointers.size === 2 ? spread() : 0
    const [right, down] = [event.clientX - before.x, event.clientY - before.y]
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY })
    moved += Math.hypot(right, down)
    if (moved < 4) return
    if (pointers.size === 2) move(orbit => zoomed(orbit, distance / Math.max(spread(), 1)))
    else if (pointers.size === 1) move(orbit => turned(orbit, -RADIANS_PER_PIXEL * right, RADIANS_PER_PIXEL * down))
  })
  const end = event => {
    if (!pointers.delete(event.pointerId)) return
    if (event.type === 'pointerup' && moved < 4 && !pointers.size) chosen(...place(event))
  }
  canvas.addEventListener('pointerup', end)
  canvas.addEventListener('pointercancel', end)
  canvas.addEventListener('wheel', event => {
    event.preventDefault()
    move(orbit => zoomed(orbit, Math.exp(clamp(event.deltaY, -240, 240) * 0.0012)))
  }, { passive: false })
}
