#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/usd/export.h"

namespace anigen::io::usd_export {

namespace {

const auto kWhole = [](auto number) { return std::to_string(number); };
const auto kTuple = [](const auto& vector) { return tuple_text(vector); };
constexpr const char* kPerVertex = "interpolation = \"vertex\"";

/// Colours of vertices, each multiplied with that of the material of the first face at it.
std::vector<Eigen::Vector4f> shown_colors(const Asset& asset) {
  const Mesh& mesh = asset.mesh;
  std::vector<Eigen::Vector4f> colors = mesh.colors;
  std::vector<char> done(colors.size(), 0);
  for (std::size_t f = 0; f < mesh.faces.size() && !colors.empty(); ++f) {
    const Material material = material_or_default(asset, mesh.face_materials.empty() ? -1 : mesh.face_materials[f]);
    if (image_of(asset, material) != nullptr) continue;  // its colour is that of the texture
    for (const std::int32_t v : mesh.faces[f]) {
      if (std::exchange(done[at(v)], 1) != 0) continue;
      colors[at(v)] = colors[at(v)].cwiseProduct(material.base_color);
    }
  }
  for (Eigen::Vector4f& color : colors) color = color.cwiseMax(0.0f).cwiseMin(1.0f);
  return colors;
}

void add_skin(const Asset& asset, const std::string& root, Lines& lines) {
  const std::size_t width = std::max<std::size_t>(1, asset.skin.largest_row());
  std::vector<std::int32_t> joints;
  std::vector<float> weights;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    for (std::size_t i = 0; i < width; ++i) {
      const bool used = i < asset.skin.row_size(v);
      joints.push_back(used ? asset.skin.row(v)[i].joint : 0);
      weights.push_back(used ? asset.skin.row(v)[i].weight : 0.0f);
    }
  }
  const std::vector<std::string> element{"elementSize = " + std::to_string(width), kPerVertex};
  lines.add("matrix4d primvars:skel:geomBindTransform = " + matrix_text(Eigen::Matrix4d::Identity()));
  lines.add_with("int[] primvars:skel:jointIndices = " + array_text(joints, kWhole), element);
  lines.add_with(
      "float[] primvars:skel:jointWeights = " + array_text(weights, [](float weight) { return number_text(weight); }),
      element);
  lines.add("rel skel:skeleton = <" + root + "/" + kSkeletonPrim + ">");
}

/// Materials as prims, and the textures that they show.
class MaterialPrims {
 public:
  MaterialPrims(const Asset& asset, std::string scope, std::string folder, std::string file, Lines& lines,
                std::vector<PackageFile>& textures)
      : asset_(asset),
        scope_(std::move(scope)),
        folder_(std::move(folder)),
        file_(std::move(file)),
        lines_(lines),
        textures_(textures) {}

  /// @return the path of the prim
  std::string add(const Material& material) {
    const std::string prim = names_.make(material.name, "Material"), path = scope_ + "/" + prim;
    lines_.open_behind("def Material \"" + prim + "\"", '(');
    lines_.add_name(material.name);
    lines_.close(')');
    lines_.open("");
    lines_.add("token outputs:surface.connect = <" + path + "/Surface.outputs:surface>");
    const EncodedImage* image = image_of(asset_, material);
    const bool has_colors = image == nullptr && !asset_.mesh.colors.empty();
    const Eigen::Vector4f color = material.base_color.cwiseMax(0.0f).cwiseMin(1.0f);
    lines_.open("def Shader \"Surface\"");
    lines_.add("uniform token info:id = \"UsdPreviewSurface\"");
    if (image != nullptr || has_colors)
      lines_.add("color3f inputs:diffuseColor.connect = <" + path +
                 (has_colors ? "/Colors.outputs:result>" : "/Picture.outputs:rgb>"));
    else
      lines_.add("color3f inputs:diffuseColor = " + tuple_text(Eigen::Vector3f(color.head<3>())));
    lines_.add("float inputs:metallic = 0");
    lines_.add("float inputs:opacity = " + number_text(color[3]));
    lines_.add("float inputs:roughness = 1");
    lines_.add("token outputs:surface");
    lines_.close();
    if (image != nullptr) {
      add_picture(path, color, texture(material.image, *image));
      add_reader("Uvs", "float2", "st");
    } else if (has_colors) {
      add_reader("Colors", "float3", "displayColor");
    }
    lines_.close();
    return path;
  }

 private:
  void add_picture(const std::string& path, const Eigen::Vector4f& color, const std::string& name) {
    lines_.open("def Shader \"Picture\"");
    lines_.add("uniform token info:id = \"UsdUVTexture\"");
    lines_.add("asset inputs:file = @./" + folder_ + "/" + name + "@");
    lines_.add("float4 inputs:scale = " + tuple_text(color));
    lines_.add("token inputs:sourceColorSpace = \"sRGB\"");
    lines_.add("float2 inputs:st.connect = <" + path + "/Uvs.outputs:result>");
    lines_.add("token inputs:wrapS = \"repeat\"");
    lines_.add("token inputs:wrapT = \"repeat\"");
    lines_.add("float3 outputs:rgb");
    lines_.close();
  }

  void add_reader(const std::string& prim, const std::string& type, const std::string& primvar) {
    lines_.open("def Shader \"" + prim + "\"");
    lines_.add("uniform token info:id = \"UsdPrimvarReader_" + type + "\"");
    lines_.add("string inputs:varname = \"" + primvar + "\"");
    lines_.add(type + " outputs:result");
    lines_.close();
  }

  /// @return the file's name
  std::string texture(int number, const EncodedImage& image) {
    const auto known = files_.find(number);
    if (known != files_.end()) return known->second;
    const std::string name = pictures_.make(image.name, "image") + image_extension(image, file_);
    textures_.push_back({name, std::string(image.bytes.begin(), image.bytes.end())});
    return files_[number] = name;
  }

  const Asset& asset_;
  std::string scope_, folder_, file_;
  Lines& lines_;
  std::vector<PackageFile>& textures_;
  Identifiers names_, pictures_;
  std::map<int, std::string> files_;  // by number of the image
};

/// Faces of each material, where there are several.
void add_subsets(const Mesh& mesh, const std::vector<int>& used, const std::vector<std::string>& materials,
                 Lines& lines) {
  Identifiers names;
  for (std::size_t m = 0; m < used.size(); ++m) {
    std::vector<std::size_t> faces;
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
      if (mesh.face_materials[f] == used[m]) faces.push_back(f);
    }
    const std::string prim = names.make(materials[m].substr(materials[m].rfind('/') + 1), "Faces");
    lines.open_behind("def GeomSubset \"" + prim + "\"", '(');
    lines.add("prepend apiSchemas = [\"MaterialBindingAPI\"]");
    lines.close(')');
    lines.open("");
    lines.add("uniform token elementType = \"face\"");
    lines.add("uniform token familyName = \"materialBind\"");
    lines.add("int[] indices = " + array_text(faces, kWhole));
    lines.add("rel material:binding = <" + materials[m] + ">");
    lines.close();
  }
}

void add_surface(const Asset& asset, bool double_sided, Lines& lines) {
  const Mesh& mesh = asset.mesh;
  const Box box = bounding_box(mesh.vertices);
  std::vector<std::int32_t> counts(mesh.faces.size(), 3), corners;
  for (const Triangle& face : mesh.faces) corners.insert(corners.end(), face.begin(), face.end());
  lines.add(std::string("uniform bool doubleSided = ") + (double_sided ? "1" : "0"));
  lines.add("float3[] extent = [" + tuple_text(Eigen::Vector3f(box.low.cast<float>())) + ", " +
            tuple_text(Eigen::Vector3f(box.high.cast<float>())) + "]");
  lines.add("int[] faceVertexCounts = " + array_text(counts, kWhole));
  lines.add("int[] faceVertexIndices = " + array_text(corners, kWhole));
  if (!mesh.normals.empty()) lines.add_with("normal3f[] normals = " + array_text(mesh.normals, kTuple), {kPerVertex});
  lines.add("point3f[] points = " + array_text(mesh.vertices, kTuple));
  if (!mesh.colors.empty()) {
    const std::vector<Eigen::Vector4f> colors = shown_colors(asset);
    lines.add_with(
        "color3f[] primvars:displayColor = " +
            array_text(colors, [](const Eigen::Vector4f& c) { return tuple_text(Eigen::Vector3f(c.head<3>())); }),
        {kPerVertex});
    if (std::any_of(colors.begin(), colors.end(), [](const Eigen::Vector4f& c) { return c[3] < 1.0f; }))
      lines.add_with("float[] primvars:displayOpacity = " +
                         array_text(colors, [](const Eigen::Vector4f& c) { return number_text(c[3]); }),
                     {kPerVertex});
  }
  if (!mesh.uvs.empty()) {
    const auto from_bottom = [](const Eigen::Vector2f& uv) {
      return tuple_text(Eigen::Vector2f(uv.x(), static_cast<float>(1.0 - static_cast<double>(uv.y()))));
    };
    lines.add_with("texCoord2f[] primvars:st = " + array_text(mesh.uvs, from_bottom), {kPerVertex});
  }
  lines.add("uniform token subdivisionScheme = \"none\"");
}

}  // namespace

void add_mesh(const Asset& asset, const std::string& root, const std::string& folder, const std::string& file,
              Lines& lines, std::vector<PackageFile>& textures) {
  const Mesh& mesh = asset.mesh;
  const std::vector<int> used = used_materials(mesh);
  std::vector<std::string> materials;
  bool double_sided = false;
  if (!used.empty()) {
    lines.open(std::string("def Scope \"") + kMaterialsPrim + "\"");
    MaterialPrims prims(asset, root + "/" + kMaterialsPrim, folder, file, lines, textures);
    for (const int m : used) {
      const Material material = material_or_default(asset, m);
      double_sided = double_sided || material.double_sided;
      materials.push_back(prims.add(material));
    }
    lines.close();
  }
  const bool has_skin = asset.skeleton.size() > 0;
  lines.open_behind(std::string("def Mesh \"") + kMeshPrim + "\"", '(');
  lines.add(has_skin ? "prepend apiSchemas = [\"MaterialBindingAPI\", \"SkelBindingAPI\"]"
                     : "prepend apiSchemas = [\"MaterialBindingAPI\"]");
  lines.close(')');
  lines.open("");
  add_surface(asset, double_sided, lines);
  if (has_skin) add_skin(asset, root, lines);
  if (materials.size() == 1) lines.add("rel material:binding = <" + materials.front() + ">");
  if (materials.size() > 1) add_subsets(mesh, used, materials, lines);
  lines.close();
}

}  // namespace anigen::io::usd_export
