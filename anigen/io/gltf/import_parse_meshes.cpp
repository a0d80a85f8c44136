#include "anigen/io/gltf/import_parse.h"

namespace anigen::io::gltf_import {
namespace {

void parse_draco(const JsonPlace& extension, const Document& document, Primitive& primitive) {
  primitive.draco_view = extension.index("bufferView", document.views.size(), "bufferView");
  const JsonPlace attributes = extension.at("attributes");
  for (const std::string& name : attributes.keys()) {
    const JsonPlace id = attributes.at(name.c_str());
    if (primitive.attribute(name) < 0) id.fail("the primitive itself has no attribute '" + name.substr(0, 40) + "'");
    primitive.draco_attributes.emplace_back(name, static_cast<std::uint32_t>(id.integer(0, 0xFFFFFFFF)));
  }
  if (primitive.mode != 4 && primitive.mode != 5) extension.fail("Draco holds triangles only");
}

Primitive parse_primitive(const JsonPlace& place, const Document& document, std::size_t materials) {
  Primitive primitive;
  primitive.pointer = place.pointer();
  primitive.mode = static_cast<int>(place.integer_or("mode", 4, 6));
  primitive.material = place.index_or_none("material", materials, "material");
  primitive.indices = place.index_or_none("indices", document.accessors.size(), "accessor");
  if (primitive.indices >= 0) {
    const Accessor& accessor = document.accessors[static_cast<std::size_t>(primitive.indices)];
    const bool is_unsigned = accessor.component == Component::kU8 || accessor.component == Component::kU16 ||
                             accessor.component == Component::kU32;
    if (accessor.type != "SCALAR" || !is_unsigned)
      place.at("indices").fail("indices must be unsigned SCALARs, not " + accessor.type);
  }
  const JsonPlace attributes = place.at("attributes");
  for (const std::string& name : attributes.keys()) {
    const int accessor = attributes.index(name.c_str(), document.accessors.size(), "accessor");
    primitive.attributes.emplace_back(name, accessor);
  }
  if (const auto targets = place.find("targets")) primitive.has_targets = targets->size() > 0;
  const auto extensions = place.find("extensions");
  const auto draco = extensions ? extensions->find("KHR_draco_mesh_compression") : std::nullopt;
  if (draco) parse_draco(*draco, document, primitive);
  return primitive;
}

}  // namespace

void parse_meshes(const JsonPlace& root, Document& document) {
  const auto list = root.find("meshes");
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const JsonPlace primitives = (*list)[i].at("primitives");
    MeshEntry mesh;
    for (std::size_t k = 0; k < primitives.size(); ++k)
      mesh.primitives.push_back(parse_primitive(primitives[k], document, document.materials.size()));
    document.meshes.push_back(std::move(mesh));
  }
}

}  // namespace anigen::io::gltf_import
