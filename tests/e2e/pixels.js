// Colours of a picture of the page, and where in it the pixels of an aerial image are.

/** Decodes a PNG in an empty page of `browser`: gives `at(x, y)` with red, green, blue. */
export async function decoded(browser, png) {
  const page = await browser.newPage();
  const { width, file } = await page.evaluate(async (text) => {
    const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${text}`)).blob());
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext('2d');
    context.drawImage(bitmap, 0, 0);
    // as text: millions of single numbers would take a minute on their way
    const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const reader = new FileReader();
    const read = new Promise((resolve) => { reader.onload = () => resolve(reader.result); });
    reader.readAsDataURL(new Blob([data]));
    return { width: bitmap.width, file: await read };
  }, png.toString('base64'));
  await page.close();
  const data = Buffer.from(file.slice(file.indexOf(',') + 1), 'base64');
  const at = (x, y) => {
    const first = 4 * (Math.round(y) * width + Math.round(x));
    return [...data.subarray(first, first + 3)];
  };
  return { at, data };
}

async function readOut(page) {
  const value = (name) => page.locator(`.viewer-${name}`).getAttribute(`data-${name}`).then(Number);
  return Promise.all(['x', 'y'].map(value));
}

// the pixel of the image that the viewer says is under a place of the screen
async function pixelUnder(page, x, y) {
  await page.mouse.move(x, y);
  return readOut(page);
}

/** From pixels of the image to the screen, by what the viewer says is under two places: `{toScreen, scale}`. */
export async function viewerScale(page) {
  const { x, y, width, height } = await page.locator('.viewer-map').boundingBox();
  const [a, b] = [[x + 0.4 * width, y + 0.2 * height], [x + 0.8 * width, y + 0.9 * height]];
  const [pixelA, pixelB] = [await pixelUnder(page, ...a), await pixelUnder(page, ...b)];
  const scale = [0, 1].map((k) => (b[k] - a[k]) / (pixelB[k] - pixelA[k]));
  return { scale: scale[0], toScreen: (px) => px.map((value, k) => a[k] + (value - pixelA[k]) * scale[k]) };
}
