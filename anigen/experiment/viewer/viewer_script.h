#pragma once

namespace anigen::experiment {

/// viewer.mjs, the module that shows assets in a report.
extern const char* const kViewerScript;

}  // namespace anigen::experiment
