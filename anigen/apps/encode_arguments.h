#pragma once
#include "anigen/generate/encode.h"

namespace anigen {

/// The command line of anigen-encode.
struct EncodeArguments {
  enum class Task { kStructure, kStructuredLatents, kReconstruct };
  Task task = Task::kStructure;
  generate::EncodeRequest encoded;       ///< of the first two
  generate::ReconstructRequest rebuilt;  ///< of the third
};

}  // namespace anigen
