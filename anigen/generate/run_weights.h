#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/config.h"
#include "anigen/nn/torch.h"

namespace anigen::generate {

/// The run folder that another run's config names. A relative name counts from the working directory, as published;
/// where nothing is there, from the nearest parent folder of the naming run in which it exists, so that a released tree
/// works from anywhere ("ckpts/anigen/ss_dae" in ckpts/anigen/ss_flow_duet/config.json).
/// @param run the naming run's folder @param config, pointer where the name stands, for messages
/// @throws InputError when the name is empty or no such folder exists
std::filesystem::path named_run(const std::filesystem::path& run, const std::string& name,
                                const std::filesystem::path& config, const std::string& pointer);

/// The two flows of a folder of runs.
struct FlowRuns {
  std::filesystem::path structure, latents;
};

/// Finds both flows below a folder: a released tree (`ckpts/anigen/…`), its `ckpts/` or `anigen/`, or a folder of runs
/// trained here. Where several variants lie beside each other the published program's defaults are taken,
/// `ss_flow_solo` and `slat_flow_auto` (docs/reference/flows.md, 5.1).
/// @param joint_count whether the second flow must have been told numbers of joints: then `slat_flow_control`
/// @param known what the user has named already; only the other one is looked for
/// @throws InputError when one is missing, or several are there and none has the usual name
FlowRuns find_flow_runs(const std::filesystem::path& folder, bool joint_count, const FlowRuns& known = {});

/// Completeness of the weights of a run folder that its config asks for: for every model under /models an object of
/// `class`; `checkpoint`, the file that generation would read; `tensors`, how many the model has, and `parameters`,
/// their elements; `complete`; and where not, `problem`, or `missing`, `unexpected` and `misshapen` with the number of
/// keys and the first of them. Models are built without initial values, files are read whole.
/// @throws InputError when there is no readable config.json
Json describe_weights(const std::filesystem::path& run);

/// One sentence about the first model of a description whose weights are not all there; empty when all are.
std::string first_incomplete(const Json& weights);

}  // namespace anigen::generate
