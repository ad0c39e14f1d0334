// The sheet with the picture on its stage: fitted, zoomed by wheel, pinch and keys, moved by hand.

const zoomMax = 32; // a picture's pixel on so many of the screen's, at least what fits

export class Viewport {
  // `changed(view)` is called when another part of the sheet is seen.
  constructor(stage, sheet, changed) {
    Object.assign(this, { stage, sheet, changed, width: 1, height: 1, x: 0, y: 0, scale: 1, fitted: true });
    this.pointers = new Map();
    new ResizeObserver(() => this.fitted ? this.fit() : this.place()).observe(stage);
    stage.addEventListener('wheel', event => this.wheel(event), { passive: false });
    stage.addEventListener('pointerdown', event => this.down(event));
    stage.addEventListener('pointermove', event => this.move(event));
    for (const end of ['pointerup', 'pointercancel'])
      stage.addEventListener(end, event => this.up(event));
    stage.addEventListener('dblclick', event => this.zoomAt(2, ...this.local(event)));
    stage.addEventListener('keydown', event => this.key(event));
  }

  // The picture's size in pixels; another one is fitted.
  resize(width, height) {
    if (width === this.width && height === this.height) return;
    Object.assign(this, { width, height });
    this.sheet.style.width = `${width}px`;
    this.sheet.style.height = `${height}px`;
    this.fit();
  }

  fitScale() {
    return Math.min(this.stage.clientWidth / this.width, this.stage.clientHeight / this.height) || 1;
  }

  fit() {
    this.fitted = true;
    this.scale = this.fitScale();
    this.place();
  }

  zoom(factor) {
    this.zoomAt(factor, this.stage.clientWidth / 2, this.stage.clientHeight / 2);
  }

  // The point of the stage stays where it is.
  zoomAt(factor, x, y) {
    const fit = this.fitScale();
    const scale = Math.min(Math.max(this.scale * factor, fit), Math.max(zoomMax, fit));
    this.x = x - (x - this.x) * scale / this.scale;
    this.y = y - (y - this.y) * scale / this.scale;
    this.scale = scale;
    this.fitted = scale === fit;
    this.place();
  }

  pan(dx, dy) {
    this.x += dx;
    this.y += dy;
    this.place();
  }

  // A sheet that is smaller than the stage is in its middle, a larger one covers it.
  place() {
    const within = (at, stage, size) =>
      size <= stage ? (stage - size) / 2 : Math.min(0, Math.max(stage - size, at));
    this.x = within(this.x, this.stage.clientWidth, this.width * this.scale);
    this.y = within(this.y, this.stage.clientHeight, this.height * this.scale);
    this.sheet.style.transform = `translate(${this.x}px, ${this.y}px) scale(${this.scale})`;
    this.sheet.classList.toggle('close-up', this.scale * devicePixelRatio >= 3);
    this.changed(this.seen());
  }

  // The part of the picture on the stage, and how large a pixel of it is on the screen.
  seen() {
    const x = Math.max(0, Math.floor(-this.x / this.scale)), y = Math.max(0, Math.floor(-this.y / this.scale));
    const right = Math.min(this.width, Math.ceil((this.stage.clientWidth - this.x) / this.scale));
    const bottom = Math.min(this.height, Math.ceil((this.stage.clientHeight - this.y) / this.scale));
    return { x, y, width: right - x, height: bottom - y, zoom: this.scale * devicePixelRatio };
  }

  local(event) {
    const box = this.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1);
    this.zoomAt(Math.exp(-pixels * (event.ctrlKey ? .01 : .0018)), ...this.local(event));
  }

  down(event) {
    this.stage.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.local(event));
    this.stage.classList.add('dragging');
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = this.local(event);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (!other) {
      this.pan(now[0] - before[0], now[1] - before[1]);
    } else {
      const distance = point => Math.max(1, Math.hypot(point[0] - other[0], point[1] - other[1]));
      this.pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
      this.zoomAt(distance(now) / distance(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    }
    this.pointers.set(event.pointerId, now);
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    this.stage.classList.toggle('dragging', this.pointers.size > 0);
  }

  key(event) {
    const step = 60;
    const deeds = {
      '+': () => this.zoom(1.5), '=': () => this.zoom(1.5), '-': () => this.zoom(1 / 1.5), '0': () => this.fit(),
      ArrowLeft: () => this.pan(step, 0), ArrowRight: () => this.pan(-step, 0),
      ArrowUp: () => this.pan(0, step), ArrowDown: () => this.pan(0, -step),
    };
    if (!deeds[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    deeds[event.key]();
  }
}
