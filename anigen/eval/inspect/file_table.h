#pragma once
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/eval/tables.h"

namespace anigen::eval {

/// A file and what inspect() said about it, or why it was rejected.
struct InspectedFile {
  std::string file;
  Json description;
  std::string rejection;  ///< empty: not rejected
};

/// One row per file: joints, vertices, faces, influences, and the codes of what was repaired, a summary of what has no
/// mesh, or the reason of the rejection; with the kind where not all are assets, and the loss by fewer influences when
/// the descriptions carry it.
Table file_table(const std::vector<InspectedFile>& files);

/// The description of a single file; a list for several. A rejected file is {"file", "rejected": reason}.
Json to_json(const std::vector<InspectedFile>& files);

}  // namespace anigen::eval
