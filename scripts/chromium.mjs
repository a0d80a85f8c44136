// Chromium and three.js for the scripts that open pages.
import {spawn} from 'node:child_process';
import {existsSync, readFileSync} from 'node:fs';
import http from 'node:http';
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

const kTypes = {'.js': 'text/javascript', '.wasm': 'application/wasm', '.glb': 'model/gltf-binary'};

// An HTTP server of one page, of three.js below /three/, and of the files that fileOf(url) names (undefined: none). What
// the page sends to /report, as JSON, goes to report().
export function servePage(page, three, fileOf, report) {
  return http.createServer((request, response) => {
    const url = decodeURIComponent(request.url.split('?')[0]);
    if (url === '/report') {
      let body = '';
      request.on('data', (part) => body += part);
      request.on('end', () => { response.end(); report(JSON.parse(body)); });
      return;
    }
    if (url === '/') return response.writeHead(200, {'content-type': 'text/html'}).end(page);
    const file = url.startsWith('/three/') ? path.join(three, path.normalize(url.slice(7))) : fileOf(url);
    if (file === undefined || !existsSync(file)) return response.writeHead(404).end();
    response.writeHead(200, {'content-type': kTypes[path.extname(file)] ?? 'application/octet-stream'}).end(readFileSync(file));
  });
}
