// Runs Khronos' glTF-Validator (npm package "gltf-validator") on files and prints one line per file.
//
//   node scripts/validate_gltf.mjs [--verbose] FILE...
//
// Exit code: 0 no errors, 1 some file has errors or cannot be read, 2 wrong usage, 77 the package is not installed.
// The package is looked for in the folders of NODE_PATH, in node_modules beside the current folder and beside this
// script.
import {createRequire} from 'node:module';
import {readFile} from 'node:fs/promises';
import path from 'node:path';
import {fileURLToPath} from 'node:url';

const kErrorSeverity = 0;
const kWarningSeverity = 1;

function loadValidator() {
  const fromEnvironment = (process.env.NODE_PATH ?? '').split(path.delimiter).filter((folder) => folder !== '');
  const beside = [process.cwd(), path.dirname(fileURLToPath(import.meta.url))].map((f) => path.join(f, 'node_modules'));
  for (const folder of [...fromEnvironment, ...beside]) {
    try {
      return createRequire(path.join(folder, 'index.js'))(path.join(folder, 'gltf-validator'));
    } catch (error) {
      if (error.code !== 'MODULE_NOT_FOUND') throw error;
    }
  }
  return null;
}

// Codes with how often each occurs, most severe first, so that a line says what to look for.
function summary(messages, severity) {
  const counts = new Map();
  for (const message of messages.filter((m) => m.severity === severity)) {
    counts.set(message.code, (counts.get(message.code) ?? 0) + 1);
  }
  return [...counts].map(([code, count]) => `${code}×${count}`).join(' ');
}

async function validate(validator, file, verbose) {
  const bytes = new Uint8Array(await readFile(file));
  const report = await validator.validateBytes(bytes, {
    uri: path.basename(file),
    maxIssues: 1000,
    externalResourceFunction: async (uri) =>
        new Uint8Array(await readFile(path.join(path.dirname(file), decodeURIComponent(uri)))),
  });
  const {numErrors, numWarnings, numInfos, messages} = report.issues;
  const codes = [kErrorSeverity, kWarningSeverity].map((s) => summary(messages, s)).filter((s) => s !== '').join(' ');
  console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos${codes && ' ' + codes}`);
  if (verbose) {
    for (const {severity, code, message, pointer} of messages) {
      console.log(`  [${severity}] ${code} ${pointer ?? ''}: ${message}`);
    }
  }
  return numErrors;
}

const verbose = process.argv.includes('--verbose');
const files = process.argv.slice(2).filter((argument) => argument !== '--verbose');
if (files.length === 0) {
  console.error('usage: node scripts/validate_gltf.mjs [--verbose] FILE...');
  process.exit(2);
}
const validator = loadValidator();
if (validator === null) {
  console.error('gltf-validator is not installed: npm install gltf-validator, or set NODE_PATH to its folder');
  process.exit(77);
}
let failed = 0;
for (const file of files) {
  try {
    if (await validate(validator, file, verbose) > 0) failed += 1;
  } catch (error) {
    console.log(`${file}: cannot be validated: ${error.message ?? error}`);
    failed += 1;
  }
}
console.log(`${files.length} files, ${failed} with errors`);
process.exit(failed > 0 ? 1 : 0);
