// One render at a time: the newest wish wins, and each gets at least its coarse frames.

import { Busy, render } from './stream.js'

const PAUSE = 1000

export class Asking {
  /** `make()` gives the request for what is wanted now, or null; `receive(message)` gets its answers, `fail(error)` why there are none. */
  constructor(make, receive, fail) {
    Object.assign(this, { make, receive, fail })
    Object.assign(this, { wanted: false, running: false, current: null, coarse: new Set(), controller: new AbortController() })
  }

  ask({ now = false } = {}) {
    this.wanted = true
    if (!this.running) this.pump()
    else if (now || !this.coarse.size) this.abort()
  }

  /** Nothing of what was asked so far is shown any more. */
  drop() {
    this.wanted = false
    this.abort()
  }

  abort() {
    this.current = null
    this.controller.abort()
  }

  /** There is something of this method to look at. */
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
        // what had been read before it was given up is not of the view that is shown now
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
