#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/config.h"
#include "anigen/nn/torch.h"

namespace anigen::generate {

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

/// Folder of the weights that come with the programs: $ANIGEN_WEIGHTS, else the first there is of weights/anigen-small
/// beside the program or in one of the three folders above it, and of that in share/anigen below the program's prefix
/// or /usr. @throws InputError naming the places when there is none
std::filesystem::path shipped_weights();
/// The run `matting` of these weights, a matting network of ours; empty when there are no weights or none of it.
/// @throws InputError when $ANIGEN_WEIGHTS is no folder
std::filesystem::path shipped_matting();
/// Likewise the runs `rig/ss_flow` and `rig/slat_flow`, which find the skeleton of a shape (field_rigger.h); both or
/// neither.
FlowRuns shipped_rig_flows();
/// Likewise the run `skin_correction`, a correction of classical skin weights.
std::filesystem::path shipped_skin_correction();

/// Completeness of the weights of a run folder that its config asks for: for every model under /models an object of
/// `class`; `checkpoint`, the file that generation would read; `tensors`, how many the model has, and `parameters`,
/// their elements; `complete`; and where not, `problem`, or `missing`, `unexpected` and `misshapen` with the number of
/// keys and the first of them. Models are built without initial values, files are read whole.
/// @throws InputError when there is no readable config.json
Json describe_weights(const std::filesystem::path& run);

/// One sentence about the first model of a description whose weights are not all there; empty when all are.
std::string first_incomplete(const Json& weights);

}  // namespace anigen::generate
