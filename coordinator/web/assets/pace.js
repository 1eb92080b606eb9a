/* pace: how often something expensive may be done again.
 *
 *   begin ... end --took longer than an animation frame or two--> rests four times as long --> begin
 *
 * With a graphics card a picture takes no time and is drawn at each change. Without one the whole of it takes some
 * 100 ms, during which the page cannot scroll: then that is done for a fifth of the time at most.
 */
const SHORT_MS = 25, RESTS = 4;

export class Pace {
  constructor() { this.begun = 0; this.until = 0; }

  begin() { this.begun = this.begun || performance.now(); }

  end() {
    if (!this.begun) return;
    const now = performance.now(), took = now - this.begun;
    this.until = took > SHORT_MS ? now + RESTS * took : 0;
    this.begun = 0;
  }

  /* Milliseconds to wait; 0: at once. */
  get rest() { return Math.max(this.until - performance.now(), 0); }
}
