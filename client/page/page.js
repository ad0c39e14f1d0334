// The live page. What comes from the farm (names, reasons) is set as text, never as HTML.
import { Viewport } from './viewport.js';
import { cost, count, duration, isOver, percent, phrase, rate } from './words.js';

const $ = id => document.getElementById(id);
const silenceMax = 12000;     // ms: the page says something every three seconds
const retryPauses = [300, 1000, 2000, 4000]; // ms

let farm = null, job = null;  // the newest of each
let selected = null;          // a job's id
let layer = 'picture';

// ------------------------------------------------------------------------------ the document

function set(element, text) { if (element.textContent !== text) element.textContent = text; }
function setState(element, state) {
  set(element, phrase(state));
  element.className = `${element.dataset.base ??= element.className.split(' ')[0]} ${state}`;
}

// As many children as there are entries, made by `make` and kept, each filled in by `fill`.
function fillList(list, entries, make, fill) {
  while (list.children.length > entries.length) list.lastElementChild.remove();
  while (list.children.length < entries.length) list.append(make());
  entries.forEach((entry, i) => fill(list.children[i], entry));
}

function element(name, className, ...children) {
  const made = document.createElement(name);
  if (className) made.className = className;
  made.append(...children);
  return made;
}

// ---------------------------------------------------------------------------------- the farm

function makeJobEntry() {
  const bar = element('progress', '');
  bar.max = 1;
  bar.setAttribute('aria-hidden', 'true');
  const button = element('button', '', element('span', 'name'), element('span', 'state'), bar, element('span', 'facts'));
  button.type = 'button';
  button.addEventListener('click', () => select(button.dataset.job, true));
  return element('li', '', button);
}

function fillJobEntry(item, entry) {
  const button = item.firstChild, [name, state, bar, facts] = button.children;
  button.dataset.job = entry.job;
  button.setAttribute('aria-current', String(entry.job === selected));
  set(name, entry.name + (entry.frame ? `, frame ${entry.frame}` : ''));
  name.title = entry.name;
  setState(state, entry.state);
  bar.value = entry.share_done;
  const words = [`#${entry.number}`, percent(entry.share_done)];
  if (entry.worker_count) words.push(entry.worker_count === 1 ? '1 worker' : `${entry.worker_count} workers`);
  if (entry.rays_per_s > 0) words.push(rate(entry.rays_per_s));
  words.push(duration(entry.elapsed_s) + (entry.remaining_s === undefined ? '' : `\u00a0<\u00a0${duration(entry.remaining_s)}`));
  set(facts, words.join(' · '));
}

function makeWorkerRow() {
  const row = element('tr', '');
  for (let i = 0; i < 6; ++i) row.append(element('td', i < 2 ? '' : 'number'));
  return row;
}

function fillWorkerRow(row, w) {
  [w.name, w.state, w.threads, w.in_flight_count, count(w.tiles_done), count(w.rays)]
    .forEach((text, i) => set(row.children[i], String(text)));
  row.firstChild.title = w.name;
}

function listed(shown, all) { return shown < all ? `${shown} of ${all}` : String(all); }

function showFarm() {
  set($('broker'), farm.broker);
  setConnection(farm.connected ? 'good' : 'lost', farm.connected ? 'connected' : 'broker lost, looking for it');
  set($('job-count'), listed(farm.jobs.length, farm.job_count));
  set($('worker-count'), listed(farm.workers.length, farm.worker_count));
  $('no-jobs').hidden = farm.jobs.length > 0 || !farm.connected;
  $('no-workers').hidden = farm.workers.length > 0 || !farm.connected;
  $('workers-scroll').hidden = farm.workers.length === 0;
  fillList($('jobs'), farm.jobs, makeJobEntry, fillJobEntry);
  fillList($('workers'), farm.workers, makeWorkerRow, fillWorkerRow);
  if (!selected) select(farm.first_job || farm.jobs[0]?.job, false);
}

function setConnection(kind, text) {
  const pill = $('connection');
  set(pill, text);
  pill.className = `pill ${kind}`;
}

function notice(text) {
  set($('notice'), text);
  $('notice').hidden = !text;
}

// ----------------------------------------------------------------------------------- the job

function select(id, byHand) {
  if (!id || id === selected) return;
  selected = id;
  job = null;
  if (byHand) history.replaceState(null, '', `#job=${id}`);
  for (const slot of [pictures.picture, pictures.map, pictures.part]) slot.clear();
  $('stage-empty').hidden = false;
  if (farm) fillList($('jobs'), farm.jobs, makeJobEntry, fillJobEntry);
  connect();
}

function showJob() {
  $('job-section').hidden = false;
  const trouble = job.trouble ?? job.reason ?? '';
  set($('job-reason'), trouble);
  $('job-reason').hidden = !trouble;
  if (job.name === undefined) return;
  set($('job-title'), job.name);
  document.title = `${percent(job.share_done)} ${job.name} – Fraja`;
  set($('job-number'), `#${job.number}` + (job.frame ? `, frame ${job.frame}` : ''));
  setState($('job-state'), job.state);
  $('progress').value = job.share_done;
  set($('percent'), percent(job.share_done));
  set($('job-workers'), String(job.worker_count));
  set($('job-rate'), rate(job.rays_per_s));
  set($('job-elapsed'), duration(job.elapsed_s));
  set($('job-remaining'), job.remaining_s === undefined ? '–' : duration(job.remaining_s));
  const cropped = job.crop.w !== job.size[0] || job.crop.h !== job.size[1];
  set($('settings'), `${job.size[0]}×${job.size[1]}` +
      (cropped ? `, of it ${job.crop.w}×${job.crop.h} from ${job.crop.x},${job.crop.y}` : '') + `, ${job.settings}`);
  $('controls').hidden = !farm?.allow_control || isOver(job.state);
  set($('pause'), job.state === 'paused' ? 'Resume' : 'Pause');
  $('save').href = `/job/${job.job}/picture.png`;
  $('save').download = `${job.name.replace(/[^\w.-]+/g, '_')}.png`;
  $('save').hidden = job.revision === 0;
  $('stage').style.aspectRatio = `${job.crop.w} / ${job.crop.h}`;
  viewport.resize(job.crop.w, job.crop.h);
  showLegend();
  pictures.update();
}

function showLegend() {
  const legend = $('legend');
  legend.hidden = layer === 'picture' || !job?.map;
  if (legend.hidden) return;
  const map = job.map;
  const now = JSON.stringify([layer, layer === 'cost' ? [map.least_s, map.most_s] : map.workers]);
  if (legend.dataset.shows === now) return;
  legend.dataset.shows = now;
  legend.replaceChildren(...layer === 'cost' ? [costScale(map)] : map.workers.map(whoEntry));
  const left = map.worker_count - map.workers.length;
  if (layer === 'workers' && left > 0) legend.append(element('span', 'small', `and ${left} more`));
}

function costScale(map) {
  const strip = element('canvas', '');
  strip.width = 128;
  strip.height = 1;
  const paint = strip.getContext('2d');
  const colours = paint.createLinearGradient(0, 0, strip.width, 0);
  map.scale.forEach((colour, i) => colours.addColorStop(i / (map.scale.length - 1), colour));
  paint.fillStyle = colours;
  paint.fillRect(0, 0, strip.width, 1);
  strip.setAttribute('role', 'img');
  strip.setAttribute('aria-label', 'from the least to the most, logarithmic');
  return element('span', 'scale', element('span', '', cost(map.least_s)), strip, element('span', '', cost(map.most_s)));
}

function whoEntry(worker) {
  const square = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  const rect = document.createElementNS('http://www.w3.org/2000/svg', 'rect');
  for (const [name, value] of [['width', 13], ['height', 13], ['aria-hidden', true]]) square.setAttribute(name, value);
  for (const [name, value] of [['width', 13], ['height', 13], ['rx', 3], ['fill', worker.colour]]) rect.setAttribute(name, value);
  square.append(rect);
  const name = element('span', '', worker.name);
  name.title = worker.name;
  return element('span', 'who', square, name, element('small', '', `${worker.tiles} ${worker.tiles === 1 ? 'tile' : 'tiles'}`));
}

// ------------------------------------------------------------------------------- its pictures

// Shows the newest of what it was asked for, one after the other: an image that is shown stays until the next one is
// here, and on a slow line revisions are left out.
class Slot {
  constructor(image) { Object.assign(this, { image, wanted: null, shown: null, busy: false }); }
  async show(url, placed) {
    this.wanted = { url, placed };
    if (this.busy) return;
    this.busy = true;
    while (this.wanted && this.wanted.url !== this.shown) {
      const { url, placed } = this.wanted;
      const next = new Image();
      next.src = url;
      try {
        await next.decode();
      } catch { // what is wrong shows in the stream
        await new Promise(done => setTimeout(done, retryPauses[1]));
        continue;
      }
      if (this.wanted?.url.split('?')[0] !== url.split('?')[0]) continue; // another job, by now
      this.image.src = next.src;
      await this.image.decode().catch(() => {});
      placed?.(this.image);
      this.image.hidden = false;
      this.image.dataset.url = this.shown = url;
      $('stage-empty').hidden = true;
    }
    this.busy = false;
  }
  clear() {
    this.wanted = null;
    this.shown = null;
    this.image.hidden = true;
  }
}

const pictures = {
  picture: new Slot($('picture')), map: new Slot($('map')), part: new Slot($('part')), timer: 0,

  update() {
    if (!job?.revision) return;
    // In the end exactly: .jpg is for what is on the move.
    const exact = job.complete && job.scale === 1;
    this.picture.show(`/job/${job.job}/picture.${exact ? 'png' : 'jpg'}?rev=${job.revision}`);
    $('map').hidden = layer === 'picture' || this.map.shown === null;
    if (layer === 'picture' || !job.map)
      this.map.clear();
    else
      this.map.show(`/job/${job.job}/${layer}.png?rev=${job.revision}`, image => this.placeMap(image, job.map.covered));
    this.updatePart();
  },

  // Whole cells, of which those at the edge reach beyond the picture.
  placeMap(image, covered) {
    image.style.left = `${covered.x - job.crop.x}px`;
    image.style.top = `${covered.y - job.crop.y}px`;
    image.style.width = `${covered.w}px`;
    image.style.height = `${covered.h}px`;
  },

  // Of a picture that is shown smaller, what is looked at closely comes pixel by pixel.
  updatePart() {
    clearTimeout(this.timer);
    const seen = viewport.seen(), partMax = 2048;
    const wanted = job?.revision && job.scale > 1 && layer === 'picture' && seen.zoom * job.scale > 1.2 &&
        seen.width > 0 && seen.height > 0 && Math.max(seen.width, seen.height) <= partMax;
    if (!wanted) return this.part.clear();
    const rect = [seen.x + job.crop.x, seen.y + job.crop.y, seen.width, seen.height];
    this.timer = setTimeout(() => this.part.show(`/job/${job.job}/part.jpg?rect=${rect}&rev=${job.revision}`, image => {
      image.style.left = `${seen.x}px`;
      image.style.top = `${seen.y}px`;
      image.style.width = `${seen.width}px`;
      image.style.height = `${seen.height}px`;
    }), 150);
  },
};

const viewport = new Viewport($('stage'), $('sheet'), () => pictures.updatePart());

function chooseLayer(chosen) {
  layer = chosen;
  for (const button of document.querySelectorAll('[data-layer]'))
    button.setAttribute('aria-pressed', String(button.dataset.layer === layer));
  pictures.map.clear();
  showLegend();
  pictures.update();
}

// ------------------------------------------------------------------------------- the stream

let stream = null; // the AbortController of the one that is open
let failures = 0;

// Opens the stream about the farm and the selected job, in place of the one there was; and again when it breaks.
async function connect() {
  stream?.abort();
  const mine = stream = new AbortController();
  while (!mine.signal.aborted && !document.hidden) {
    const why = await read(mine).catch(error => error instanceof Refused ? error.message : 'fraja-watch is gone');
    if (mine.signal.aborted) return;
    setConnection('lost', 'not connected');
    notice(`${why}; trying again.`);
    await new Promise(done => setTimeout(done, retryPauses[Math.min(failures++, retryPauses.length - 1)]));
  }
}

class Refused extends Error {}

async function read(mine) {
  const giveUp = new AbortController(); // a line that went dead says nothing
  mine.signal.addEventListener('abort', () => giveUp.abort());
  let timer = 0;
  const heard = () => {
    clearTimeout(timer);
    timer = setTimeout(() => giveUp.abort(), silenceMax);
  };
  heard();
  try {
    const answer = await fetch(selected ? `/events?job=${selected}` : '/events', { signal: giveUp.signal, cache: 'no-store' });
    if (!answer.ok) throw new Refused((await answer.text()).trim());
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    for (let rest = '';;) {
      const { done, value } = await reader.read();
      if (done) return 'fraja-watch is gone';
      heard();
      failures = 0;
      notice('');
      const lines = (rest + value).split('\n');
      rest = lines.pop();
      lines.forEach(line => mine.signal.aborted || take(JSON.parse(line)));
    }
  } finally {
    clearTimeout(timer);
    giveUp.abort();
  }
}

function take(news) {
  if (news.farm) {
    farm = news.farm;
    showFarm();
  }
  if (news.job?.job === selected && selected) {
    job = news.job;
    showJob();
  }
}

// ---------------------------------------------------------------------------------- control

async function order(deed) {
  const answer = await fetch(`/job/${selected}/${deed}`, { method: 'POST' }).catch(() => null);
  notice(answer?.ok ? '' : answer ? (await answer.text()).trim() : 'fraja-watch is gone; nothing was done.');
}

$('pause').addEventListener('click', () => order(job.state === 'paused' ? 'resume' : 'pause'));
$('cancel').addEventListener('click', () => {
  set($('ask-text'), `Cancel ${job.name} #${job.number}? What has been rendered of it stays; nothing more will be.`);
  $('ask').showModal();
});
$('ask-no').addEventListener('click', () => $('ask').close());
$('ask-yes').addEventListener('click', () => {
  $('ask').close();
  order('cancel');
});
$('zoom-in').addEventListener('click', () => viewport.zoom(1.5));
$('zoom-out').addEventListener('click', () => viewport.zoom(1 / 1.5));
$('zoom-fit').addEventListener('click', () => viewport.fit());
for (const button of document.querySelectorAll('[data-layer]'))
  button.addEventListener('click', () => chooseLayer(button.dataset.layer));
document.addEventListener('visibilitychange', () => document.hidden ? stream?.abort() : connect());
addEventListener('hashchange', () => select(jobInAddress(), true));

function jobInAddress() { return location.hash.match(/^#job=([0-9a-f-]{36})$/)?.[1]; }

history.replaceState(null, '', location.pathname + location.hash); // a token does not stay in sight
selected = jobInAddress() ?? null;
connect();
