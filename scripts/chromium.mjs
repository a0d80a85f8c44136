// Chromium and three.js for the scripts that open pages.
import {spawn} from 'node:child_process';
import {existsSync} from 'node:fs';
import path from 'node:path';

// Path of Chromium or Chrome; undefined when neither is installed.
export function chromium() {
  const folders = (process.env.PATH ?? '').split(path.delimiter);
  return folders.flatMap((f) => ['chromium', 'chromium-browser', 'google-chrome'].map((n) => path.join(f, n)))
      .find((f) => existsSync(f));
}

// Folder of the npm package "three", in the folders of NODE_PATH or in node_modules beside the current folder; undefined
// when it is not installed.
export function threeFolder() {
  const folders = [...(process.env.NODE_PATH ?? '').split(path.delimiter), path.join(process.cwd(), 'node_modules')];
  return folders.filter((f) => f !== '').map((f) => path.join(f, 'three')).find((f) => existsSync(path.join(f, 'build')));
}

// Opens a page without a window; WebGL is computed on the CPU. Returns the process.
export function openHeadless(browser, profile, url) {
  return spawn(browser, ['--headless=new', '--no-sandbox', '--disable-gpu-sandbox', '--use-angle=swiftshader',
                         '--enable-unsafe-swiftshader', '--no-first-run', `--user-data-dir=${profile}`, url], {stdio: 'ignore'});
}
