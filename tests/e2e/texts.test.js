// The texts of all languages: the same keys with the same places for values, all of them used, none missing.

import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { test } from 'node:test';
import { fileURLToPath } from 'node:url';

const ASSETS = join(dirname(fileURLToPath(import.meta.url)), '../../src/web/assets');
const LANGUAGES = readdirSync(join(ASSETS, 'texts'));

/** All texts of a language by their whole keys. */
async function texts(file) {
  const source = readFileSync(join(ASSETS, 'texts', file), 'utf8');
  const { default: tree } = await import(`data:text/javascript,${encodeURIComponent(source)}`);
  const flat = (node, path) => Object.entries(node).flatMap(([key, value]) => (
    typeof value === 'string' ? [[[...path, key].join('.'), value]] : flat(value, [...path, key])));
  return new Map(flat(tree, []));
}

/** The sources of the pages. */
function sources() {
  const files = readdirSync(ASSETS, { recursive: true }).map(String);
  const own = files.filter((file) => file.endsWith('.js') && !/^(vendor|texts)\//.test(file));
  return own.map((file) => [file, readFileSync(join(ASSETS, file), 'utf8')]);
}

const places = (text) => [...text.matchAll(/\{(\w+)\}/g)].map(([, name]) => name).sort();

test('every language has the same texts, with the same places for values', async () => {
  const [first, ...others] = await Promise.all(LANGUAGES.map(texts));
  assert.ok(first.size > 100 && others.length > 0);
  for (const other of others) {
    assert.deepEqual([...other.keys()].sort(), [...first.keys()].sort());
    for (const [key, text] of first) assert.deepEqual(places(other.get(key)), places(text), key);
  }
});

test('every text that a page asks for is there', async () => {
  const known = await texts(LANGUAGES[0]);
  let asked = 0;
  for (const [file, source] of sources()) {
    for (const [, key] of source.matchAll(/\bt\('([\w.]+)'/g)) {
      asked += 1;
      assert.ok(known.has(key), `${file} asks for ${key}`);
    }
    // of a key that is put together, the part that is fixed
    for (const [, start] of source.matchAll(/\bt\(`([\w.]+)\$\{/g)) {
      assert.ok([...known.keys()].some((key) => key.startsWith(start)), `${file} asks for ${start}…`);
    }
  }
  assert.ok(asked > 100);
});

test('no text is kept that nothing asks for', async () => {
  const all = sources().map(([, source]) => source).join('\n');
  const asked = (key) => {
    const last = key.split('.').at(-1);
    const starts = key.split(/(?<=[._])/).map((_, index, parts) => parts.slice(0, index).join(''));
    return all.includes(`'${key}'`) || starts.some((start) => start && all.includes(`\`${start}\${`))
      || all.includes(`'${last}'`);
  };
  const unused = [...(await texts(LANGUAGES[0])).keys()].filter((key) => !asked(key));
  assert.deepEqual(unused, []);
});
