// Positions as people type or paste them.

/**
 * `x, y, height` out of a text, or null. Numbers stand apart by semicolons, spaces, or commas where the decimals have
 * points: `7.1, 50.7, 280` and `7,1; 50,7; 280` are the same.
 */
export function parsePosition(text) {
  const trimmed = text.trim();
  const apart = trimmed.includes(';') ? ';' : /\d\s+[-+\d]/.test(trimmed) ? /\s+/ : ',';
  const parts = trimmed.split(apart).map((part) => part.trim().replace(/,$/, '').replace(',', '.')).filter(Boolean);
  const numbers = parts.map(Number);
  return numbers.length === 3 && numbers.every(Number.isFinite) ? numbers : null;
}

/** Three numbers of a text as of `parsePosition`, or one for all three, or null. */
export function parseThree(text) {
  const one = Number(text.trim().replace(',', '.'));
  return text.trim() && Number.isFinite(one) ? [one, one, one] : parsePosition(text);
}
