// Pictures of all pages, to be looked at: light, dark, in German, and on a tablet.

import { mkdirSync } from 'node:fs';
import { join } from 'node:path';
import { launch, oriented, scene, service, variant } from './support.js';

const folder = process.argv[2];
mkdirSync(folder, { recursive: true });

const LOOKS = {
  light: { theme: 'light' },
  dark: { theme: 'dark' },
  german: { theme: 'light', language: 'de' },
  tablet: { theme: 'light', viewport: { width: 1024, height: 768 } },
};

const running = await service();
const { photograph } = scene();
const doubtful = await oriented(running, { bytes: variant(photograph, 'doubtful'), name: 'doubtful.png', request: { threshold: 99 } });
await oriented(running, { bytes: variant(photograph, 'elsewhere'), name: 'elsewhere.png', request: {
  approximation: { position: { crs: 'EPSG:4979', coordinates: [9, 48, 300] } },
} });
const PAGES = {
  queue: '/', upload: '/upload', result: `/orientations/${running.orientation}`, doubtful: `/orientations/${doubtful.id}`,
  control: '/control', diagnosis: '/diagnosis', classifier: '/diagnosis/shipped', dashboard: '/dashboard', help: '/help', login: '/login',
};

const browser = await launch();
for (const [look, options] of Object.entries(LOOKS)) {
  for (const [name, address] of Object.entries(PAGES)) {
    const page = await browser.page(running.url + address, options);
    await page.locator('main > *').first().waitFor();
    // events are open as long as the page is: that nothing has been loaded for a while is told by the pictures
    await page.waitForFunction(() => [...document.images].every((image) => image.complete) && !document.querySelector('[aria-busy=true]'));
    await page.evaluate(() => new Promise((resolve) => { requestIdleCallback(resolve, { timeout: 3000 }); }));
    await page.screenshot({ path: join(folder, `${name}-${look}.png`) });
    await page.context().close();
    console.log(`${name}-${look}.png`);
  }
}
await running.stop();
await browser.close();
