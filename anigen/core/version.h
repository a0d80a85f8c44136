#pragma once
#include <string>

#include "anigen/core/config.h"

namespace anigen {

/// The project's version, from CMakeLists.txt. cmake/AnigenVersion.cmake writes what is declared here.
extern const char* const kVersion;

/// The commit that this build was made of, which results carry: of the newest commit that changed what the programs are
/// built from, the first ten digits; "+changes" follows when files of those were changed since. "unknown" outside git.
/// Two builds count as one program when this is equal.
const char* commit();

/// "GNU 12.2.0", the compiler of this build.
extern const char* const kCompiler;

/// "1.13.0", the LibTorch that this build was made for; "" in a build without.
extern const char* const kTorchVersion;

/// Record of the program that makes a file, which every result carries:
/// {"program": "AniGen", "version", "commit", "compiler", "libtorch"}, the last one in builds with LibTorch.
inline Json made_by() {
  Json record = {{"program", "AniGen"}, {"version", kVersion}, {"commit", commit()}, {"compiler", kCompiler}};
  if (kTorchVersion[0] != '\0') record["libtorch"] = kTorchVersion;
  return record;
}

/// Commit in the record "made_by" of a result; "" where there is none.
inline std::string commit_of(const Json& result) {
  const Json* record = result.is_object() && result.contains("made_by") ? &result["made_by"] : nullptr;
  return record != nullptr && record->is_object() && (*record)["commit"].is_string()
             ? (*record)["commit"].get<std::string>()
             : "";
}

/// "0.2.0, commit 77b6240d1f", for people.
inline std::string named_version() { return std::string(kVersion) + ", commit " + commit(); }

/// "commit 77b6240d1f". @param commit as a result's record has it, "" where it has none
inline std::string named_commit(const std::string& commit) {
  return commit.empty() ? "a program that recorded no commit" : "commit " + commit;
}

}  // namespace anigen
