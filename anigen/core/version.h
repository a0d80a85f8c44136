#pragma once
#include <string>

namespace anigen {

/// The project's version, from CMakeLists.txt. cmake/AnigenVersion.cmake writes what is declared here.
extern const char* const kVersion;

/// The commit that this build was made of, which results carry: of the newest commit that changed what the programs are
/// built from, the first ten digits; "+changes" follows when files of those were changed since. "unknown" outside git.
/// Two builds count as one program when this is equal.
const char* commit();

/// "0.1.0, commit 77b6240d1f", for people.
inline std::string named_version() { return std::string(kVersion) + ", commit " + commit(); }

/// "commit 77b6240d1f". @param commit as a result's record has it, "" where it has none
inline std::string named_commit(const std::string& commit) {
  return commit.empty() ? "a program that recorded no commit" : "commit " + commit;
}

}  // namespace anigen
