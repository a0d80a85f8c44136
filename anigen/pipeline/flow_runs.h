#pragma once
#include <filesystem>

namespace anigen::pipeline {

/// The two flows of a folder of runs.
struct FlowRuns {
  std::filesystem::path structure, latents;
};

/// Finds both flows below a folder: a released tree (`ckpts/anigen/…`), its `ckpts/` or `anigen/`, or a folder of runs
/// trained here. Where several variants lie beside each other the published program's defaults are taken,
/// `ss_flow_solo` and `slat_flow_auto` (reference flows-and-pipeline.md, 5.1).
/// @param joint_count whether the second flow must have been told numbers of joints: then `slat_flow_control`
/// @param known what the user has named already; only the other one is looked for
/// @throws InputError when one is missing, or several are there and none has the usual name
FlowRuns find_flow_runs(const std::filesystem::path& folder, bool joint_count, const FlowRuns& known = {});

}  // namespace anigen::pipeline
