#include "anigen/io/gltf/gltf.h"

#include <new>
#include <stdexcept>

#include "anigen/core/error.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"

namespace anigen::io {

ImportedAsset read_gltf(const std::filesystem::path& path, const ImportOptions& options) {
  try {
    gltf_import::Notes notes;
    gltf_import::Container container;
    gltf_import::read_container(path, options, container);
    const gltf_import::Document document = gltf_import::parse_document(container, options, notes);
    return gltf_import::document_asset(document, path, options, notes);
  } catch (const std::bad_alloc&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(path.string(), "", "reading it needs more memory than there is");
  }
}

}  // namespace anigen::io
