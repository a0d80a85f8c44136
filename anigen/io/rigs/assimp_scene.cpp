#include "anigen/io/rigs/assimp_scene.h"

#include <new>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/guarded_process.h"
#include "anigen/io/gltf/import_document_asset.h"
#include "anigen/io/rigs/assimp_animations.h"
#include "anigen/io/rigs/assimp_document.h"
#include "anigen/io/rigs/assimp_load.h"
#include "anigen/io/rigs/assimp_materials.h"
#include "anigen/io/rigs/assimp_meshes.h"
#include "anigen/io/rigs/assimp_nodes.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kTooLarge = "reading it needs more memory than there is";

/// Many times what sound files take.
constexpr double kSeconds = 30.0, kSecondsPerMebibyte = 1.0;
constexpr std::uint64_t kMemory = std::uint64_t{8} << 30, kMemoryPerByte = 32;

/// First byte of what the process that reads sends.
enum class Answer : char { kDocument, kInputError, kNotSupported };

std::string message(Answer answer, const std::string& place, const std::string& problem) {
  return static_cast<char>(answer) + place + '\0' + problem;
}

std::string read_with_assimp(const fs::path& path, const ImportOptions& options) {
  try {
    Assimp::Importer importer;
    gltf_import::Notes notes;
    gltf_import::Document document;
    document.file = path.string();
    const aiScene& scene = assimp_import::load(importer, path, options, document.frame);
    const assimp_import::NodeTable nodes = assimp_import::add_nodes(scene, lower_extension(path) == ".fbx", document);
    assimp_import::add_animations(scene, nodes, document);
    assimp_import::add_meshes(scene, nodes, document, notes);
    assimp_import::add_materials(scene, path.parent_path(), document);
    return static_cast<char>(Answer::kDocument) + assimp_import::to_bytes(document, notes);
  } catch (const NotSupportedError& error) {
    return message(Answer::kNotSupported, error.place(), error.problem());
  } catch (const InputError& error) {
    return message(Answer::kInputError, error.place(), error.problem());
  } catch (const Error& error) {
    return message(Answer::kInputError, "", error.what());
  } catch (const std::bad_alloc&) {
    return message(Answer::kInputError, "", kTooLarge);
  } catch (const std::length_error&) {
    return message(Answer::kInputError, "", kTooLarge);
  }
}

[[noreturn]] void refuse(Answer answer, const std::string& text, const std::string& file) {
  const std::size_t end = text.find('\0', 1);
  const std::string place = text.substr(1, end - 1);
  std::string problem = text.substr(end + 1);
  if (answer != Answer::kNotSupported) throw InputError(file, place, problem);
  const std::string prefix = NotSupportedError("", "", "").problem();
  if (problem.compare(0, prefix.size(), prefix) == 0) problem.erase(0, prefix.size());
  throw NotSupportedError(file, place, problem);
}

}  // namespace

ImportedAsset read_assimp(const fs::path& path, const ImportOptions& options) {
  const std::string file = path.string();
  try {
    ProcessLimits limits;
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(path, error);
    const std::uint64_t size = error ? 0 : static_cast<std::uint64_t>(bytes);
    limits.cpu_seconds = kSeconds + kSecondsPerMebibyte * static_cast<double>(size) / (1 << 20);
    limits.more_memory = kMemory + kMemoryPerByte * size;
    GuardedWork work = run_guarded([&] { return read_with_assimp(path, options); }, limits);
    if (!work.finished) {
      throw InputError(file, "",
                       "Assimp cannot read it: it " + work.failure +
                           "; the file is damaged or hostile: export it again, best as .glb");
    }
    const auto answer = static_cast<Answer>(work.result.front());
    if (answer != Answer::kDocument) refuse(answer, work.result, file);
    gltf_import::Notes notes;
    gltf_import::Document document;
    document.file = file;
    assimp_import::from_bytes(std::string_view(work.result).substr(1), document, notes);
    work.result = {};
    return gltf_import::document_asset(document, path, options, notes);
  } catch (const std::bad_alloc&) {
    throw InputError(file, "", kTooLarge);
  } catch (const std::length_error&) {
    throw InputError(file, "", kTooLarge);
  }
}

}  // namespace anigen::io
