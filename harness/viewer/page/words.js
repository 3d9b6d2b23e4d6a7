// What is said of the camera and of the view cache.

import { made } from './panel.js'

/** Nodes: where the camera stands, and how far from a view of the ground truth. */
export function ofPlace({ scene, view, near, orbit }) {
  const degrees = angle => `${(angle * 180 / Math.PI).toFixed(1)}°`
  const azimuth = ((orbit.azimuth + Math.PI) % (2 * Math.PI)) - Math.PI
  const pose = `azimuth ${degrees(azimuth)}, elevation ${degrees(orbit.elevation)}, distance ${orbit.distance.toFixed(2)}`
  if (view !== null) return ['At ', made('b', `test view ${view + 1} of ${scene.views.length}`), ` · ${pose}`]
  if (!near) return [`Free · ${pose}`]
  return [`Free · nearest: test view ${near.index + 1} of ${scene.views.length}, ${near.degrees.toFixed(1)}° away · ${pose}`]
}

export function ofCache(cache) {
  const cached = ['level 0', 'level 1', 'level 2'].map(level => cache.sources[level] ?? 0)
  const hits = cached.reduce((sum, value) => sum + value, 0), all = hits + (cache.sources.rendered ?? 0)
  const size = bytes => `${(bytes / 2 ** 20).toFixed(1)} MiB`
  const parts = [`View cache, all pages together since the server began: ${hits} of ${all} pictures (${all ? Math.round(100 * hits / all) : 0} %) served from it`]
  if (hits) parts.push(`memory ${cached[0] + cached[1]}, disk ${cached[2]}`)
  parts.push(`holds about ${size(cache.memory_bytes)} in memory${cache.memory_alone ? '' : `, ${size(cache.disk_bytes)} on disk`}`)
  if (cache.memory_alone) parts.push(`nothing is kept on disk: ${cache.memory_alone}`)
  if (cache.failed_writes) parts.push(`${cache.failed_writes} writes failed: ${cache.last_failure}`)
  if (cache.damaged) parts.push(`${cache.damaged} damaged files dropped`)
  return parts.join(' · ')
}
