#pragma once
#include "anigen/io/ndarray.h"

namespace anigen::models {

/// DINOv2's weights are published twice: as `.pth` under the hub's own keys, which the model here uses, and as
/// `.safetensors` of the Hugging Face repositories under the keys of its `transformers` library ("encoder.layer.3.…"),
/// where queries, keys and values are apart. Brings the second form to the first; arrays without any key of the second
/// form come back as they are, and so do keys that belong to neither.
io::NamedArrays to_hub_keys(io::NamedArrays arrays);

}  // namespace anigen::models
