// Where Chromium or Chrome is installed, for the scripts that open pages in it; undefined when it is not.
import {existsSync} from 'node:fs';
import path from 'node:path';

export function chromium() {
  const folders = (process.env.PATH ?? '').split(path.delimiter);
  return folders.flatMap((f) => ['chromium', 'chromium-browser', 'google-chrome'].map((n) => path.join(f, n)))
      .find((f) => existsSync(f));
}
