// Numbers and states in the words of the other programs.

export function duration(s) {
  const whole = Math.max(0, Math.floor(s)), two = n => String(n).padStart(2, '0');
  const h = Math.floor(whole / 3600), m = Math.floor(whole / 60) % 60;
  return h ? `${h}:${two(m)}:${two(whole % 60)}` : `${m}:${two(whole % 60)}`;
}

function scaled(value, unit, prefixes) {
  let power = 0;
  while (value >= 999.5 && power + 1 < prefixes.length) { value /= 1000; ++power; }
  const digits = power === 0 || value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2;
  return `${value.toFixed(digits)}\u202f${prefixes[power]}${unit}`;
}
export const count = n => n < 1000 ? String(n) : scaled(n, '', ['', 'k', 'M', 'G', 'T']).replace('\u202f', '');
export const rate = raysPerS => raysPerS > 0 ? scaled(raysPerS, 'ray/s', ['', 'k', 'M', 'G', 'T']) : '–';
export const cost = s => scaled(s * 1e9, 's', ['n', 'µ', 'm', '']) + ' a pixel';
export const percent = share => `${Math.floor(100 * share + 1e-9)}%`; // 100 is the end
export const phrase = state => state.replaceAll('_', ' ');
export const isOver = state => ['done', 'failed', 'cancelled'].includes(state);
