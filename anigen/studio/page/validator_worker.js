// Khronos' glTF-Validator beside the page. Its file is a script for Node.js that puts its functions into `exports`, and
// takes them from the worker's scope where there is no Node.js.
self.exports = {};
importScripts('/gltf-validator/gltf_validator.dart.js');

self.onmessage = async ({data: {turn, bytes, name}}) => {
  try {
    const report = await self.exports.validateBytes(new Uint8Array(bytes), {uri: name, maxIssues: 100, writeTimestamp: false});
    self.postMessage({turn, issues: report.issues, version: report.validatorVersion});
  } catch (problem) {
    self.postMessage({turn, failure: String(problem?.message ?? problem)});
  }
};
