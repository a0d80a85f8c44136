#pragma once
#include "anigen/pipeline/encode_structured_latent.h"

namespace anigen {

/// The command line of anigen-encode.
struct EncodeArguments {
  enum class Task { kStructure, kStructuredLatents, kReconstruct };
  Task task = Task::kStructure;
  pipeline::EncodeRequest encoded;       ///< of the first two
  pipeline::ReconstructRequest rebuilt;  ///< of the third
  bool allow_failures = false;
};

}  // namespace anigen
