#include "anigen/core/error.h"
#include "anigen/io/rigs/read_assimp.h"

namespace anigen::io {

ImportedAsset read_assimp(const std::filesystem::path& file, const ImportOptions& /*options*/) {
  throw NotSupportedError(file.string(), "", "FBX and COLLADA by a build without Assimp; convert the file to glTF");
}

}  // namespace anigen::io
