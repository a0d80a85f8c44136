#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/ndarray.h"
#include "anigen/models/lpips.h"

namespace anigen::models {

/// Arrays with the name of the file they come from.
struct LpipsArrays {
  std::string file;
  io::NamedArrays arrays;
};

/// Fills the network, in fp32. Trunk: "features.N.weight" and "features.N.bias" (torchvision's vgg16, whose classifier
/// is ignored like every other key), or "net.sliceS.N.weight" (a whole LPIPS of the lpips package). Heads:
/// "linS.model.1.weight". Trunk and heads may stand in one file or in several, in any order.
/// @throws InputError naming file and key for a weight that is missing, stands twice, has another shape, is not
/// floating-point, or is not finite; the network is then unchanged
void set_lpips_weights(LpipsImpl& lpips, const std::vector<LpipsArrays>& sources);

/// LPIPS with weights from `.pt`, `.pth` or `.safetensors` files (io::read_state_dict), on the CPU.
/// @throws InputError also for files that cannot be read
Lpips load_lpips(const std::vector<std::filesystem::path>& files);

}  // namespace anigen::models
