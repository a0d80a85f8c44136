#include "anigen/models/dinov2_weights.h"

#include "anigen/io/torch_archive.h"
#include "anigen/models/dinov2_keys.h"
#include "anigen/models/state_dict.h"
#include "anigen/models/weight_checks.h"

namespace anigen::models {

void load_dinov2_weights(Dinov2& model, const std::filesystem::path& file) {
  const io::NamedArrays arrays = to_hub_keys(io::read_state_dict(file));
  check_weight_values(arrays, file.string());
  load_state_dict(*model, arrays, LoadMode::kStrict, file.string());
  for (const Tensor& parameter : model->parameters()) parameter.requires_grad_(false);
  model->eval();
}

}  // namespace anigen::models
