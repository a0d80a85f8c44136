#include "tests/support/scene_files.h"

#include <Eigen/Core>
#include <cmath>
#include <sstream>
#include <vector>

namespace anigen::test {
namespace {

template <typename T>
std::string list(const std::vector<T>& values, const char* between) {
  std::ostringstream text;
  text.precision(9);
  for (std::size_t i = 0; i < values.size(); ++i) text << (i == 0 ? "" : between) << values[i];
  return text.str();
}

std::string array(const std::string& name, const std::string& values, std::size_t count) {
  return name + ": *" + std::to_string(count) + " {\n\ta: " + values + "\n}\n";
}

std::string source(const std::string& id, const std::string& kind, const std::string& values, std::size_t count,
                   std::size_t stride, const std::string& parameter) {
  std::ostringstream text;
  const std::string tag = kind == "Name" ? "Name_array" : "float_array";
  const std::string type = kind == "Name" ? "name" : stride == 16 ? "float4x4" : "float";
  text << "<source id=\"" << id << "\"><" << tag << " id=\"" << id << "-a\" count=\"" << count << "\">" << values
       << "</" << tag << "><technique_common><accessor source=\"#" << id << "-a\" count=\"" << count / stride
       << "\" stride=\"" << stride << "\">";
  if (stride == 3) {
    for (const char* axis : {"X", "Y", "Z"}) text << "<param name=\"" << axis << "\" type=\"float\"/>";
  } else {
    text << "<param name=\"" << parameter << "\" type=\"" << type << "\"/>";
  }
  text << "</accessor></technique_common></source>\n";
  return text.str();
}

Eigen::Vector3d joint(const RigFile& rig, std::size_t j) {
  return {rig.joints[3 * j], rig.joints[3 * j + 1], rig.joints[3 * j + 2]};
}

Eigen::Vector3d offset(const RigFile& rig, std::size_t j) {
  return j == 0 ? joint(rig, 0) : Eigen::Vector3d(joint(rig, j) - joint(rig, j - 1));
}

std::string triple(const Eigen::Vector3d& v, const char* between) {
  return list(std::vector<double>{v.x(), v.y(), v.z()}, between);
}

}  // namespace

std::string collada_text(const RigFile& rig, const SceneOptions& options) {
  std::ostringstream text;
  text << "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
          "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\">\n"
          "<asset><unit name=\"u\" meter=\""
       << options.unit << "\"/><up_axis>Z_UP</up_axis></asset>\n";
  if (!options.diffuse_texture.empty())
    text << "<library_images><image id=\"picture\"><init_from>" << options.diffuse_texture
         << "</init_from></image></library_images>\n";
  text << "<library_effects><effect id=\"effect\"><profile_COMMON>";
  if (!options.diffuse_texture.empty()) {
    text << "<newparam sid=\"surface\"><surface type=\"2D\"><init_from>picture</init_from></surface></newparam>"
            "<newparam sid=\"sampler\"><sampler2D><source>surface</source></sampler2D></newparam>";
  }
  text << "<technique sid=\"common\"><lambert><diffuse>"
       << (options.diffuse_texture.empty() ? "<color>0.25 0.5 0.75 1</color>"
                                           : "<texture texture=\"sampler\" texcoord=\"UV\"/>")
       << "</diffuse></lambert></technique></profile_COMMON></effect></library_effects>\n"
          "<library_materials><material id=\"material\" name=\"skin\"><instance_effect url=\"#effect\"/></material>"
          "</library_materials>\n"
          "<library_geometries><geometry id=\"mesh\"><mesh>\n"
       << source("positions", "float", list(rig.vertices, " "), rig.vertices.size(), 3, "")
       << "<vertices id=\"vertices\"><input semantic=\"POSITION\" source=\"#positions\"/></vertices>\n"
          "<triangles count=\""
       << rig.faces.size() / 3
       << "\" material=\"slot\"><input semantic=\"VERTEX\" source=\"#vertices\" offset=\"0\"/><p>"
       << list(rig.faces, " ") << "</p></triangles></mesh></geometry></library_geometries>\n";

  std::string names, binds, counts, pairs;
  std::vector<float> weights;
  for (int j = 0; j < rig.joint_count(); ++j) {
    const Eigen::Vector3d p = joint(rig, static_cast<std::size_t>(j));
    names += (j == 0 ? "" : " ") + (j == 1 ? options.bone_name : "j" + std::to_string(j));
    binds += list(std::vector<double>{1, 0, 0, -p.x(), 0, 1, 0, -p.y(), 0, 0, 1, -p.z(), 0, 0, 0, 1}, " ") + " ";
  }
  for (int v = 0; v < rig.vertex_count(); ++v) {
    int used = 0;
    for (int j = 0; j < rig.skin_columns; ++j) {
      const float weight = rig.skin[static_cast<std::size_t>(v * rig.skin_columns + j)];
      if (weight == 0.0f) continue;
      ++used;
      pairs += std::to_string(j) + " " + std::to_string(weights.size()) + " ";
      weights.push_back(weight);
    }
    counts += std::to_string(used) + " ";
  }
  const auto joints = static_cast<std::size_t>(rig.joint_count());
  text << "<library_controllers><controller id=\"skin\"><skin source=\"#mesh\">"
          "<bind_shape_matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>\n"
       << source("names", "Name", names, joints, 1, "JOINT")
       << source("binds", "float", binds, 16 * joints, 16, "TRANSFORM")
       << source("weights", "float", list(weights, " "), weights.size(), 1, "WEIGHT")
       << "<joints><input semantic=\"JOINT\" source=\"#names\"/><input semantic=\"INV_BIND_MATRIX\" source=\"#binds\"/>"
          "</joints>\n<vertex_weights count=\""
       << rig.vertex_count()
       << "\"><input semantic=\"JOINT\" source=\"#names\" offset=\"0\"/><input semantic=\"WEIGHT\" source=\"#weights\" "
          "offset=\"1\"/><vcount>"
       << counts << "</vcount><v>" << pairs << "</v></vertex_weights></skin></controller></library_controllers>\n";
  if (options.animated) {
    text << "<library_animations><animation id=\"walk\" name=\"walk\">\n"
         << source("times", "float", "0 1", 2, 1, "TIME") << source("angles", "float", "0 90", 2, 1, "ANGLE")
         << source("kinds", "Name", "LINEAR LINEAR", 2, 1, "INTERPOLATION")
         << "<sampler id=\"sampler-1\"><input semantic=\"INPUT\" source=\"#times\"/><input semantic=\"OUTPUT\" "
            "source=\"#angles\"/><input semantic=\"INTERPOLATION\" source=\"#kinds\"/></sampler>"
            "<channel source=\"#sampler-1\" target=\"j1/turn.ANGLE\"/></animation></library_animations>\n";
  }
  text << "<library_visual_scenes><visual_scene id=\"scene\">\n";
  for (std::size_t j = 0; j < joints; ++j) {
    text << "<node id=\"j" << j << "\" sid=\"j" << j << "\" name=\"j" << j
         << "\" type=\"JOINT\"><translate sid=\"move\">" << triple(offset(rig, j), " ")
         << "</translate><rotate sid=\"turn\">1 0 0 0</rotate>\n";
  }
  for (std::size_t j = 0; j < joints; ++j) text << "</node>";
  text << "\n<node id=\"body\"><instance_controller url=\"#skin\"><skeleton>#j0</skeleton><bind_material>"
          "<technique_common><instance_material symbol=\"slot\" target=\"#material\"/></technique_common>"
          "</bind_material></instance_controller></node>\n"
          "</visual_scene></library_visual_scenes><scene><instance_visual_scene url=\"#scene\"/></scene></COLLADA>\n";
  return text.str();
}

std::string fbx_text(const RigFile& rig, const SceneOptions& options) {
  std::ostringstream text;
  text
      << "; FBX 7.4.0 project file\nFBXHeaderExtension:  {\n\tFBXHeaderVersion: 1003\n\tFBXVersion: 7400\n}\n"
         "GlobalSettings:  {\n\tVersion: 1000\n\tProperties70:  {\n"
         "\t\tP: \"UpAxis\", \"int\", \"Integer\", \"\",2\n\t\tP: \"UpAxisSign\", \"int\", \"Integer\", \"\",1\n"
         "\t\tP: \"FrontAxis\", \"int\", \"Integer\", \"\",1\n\t\tP: \"FrontAxisSign\", \"int\", \"Integer\", \"\",-1\n"
         "\t\tP: \"CoordAxis\", \"int\", \"Integer\", \"\",0\n\t\tP: \"CoordAxisSign\", \"int\", \"Integer\", \"\",1\n"
         "\t\tP: \"UnitScaleFactor\", \"double\", \"Number\", \"\","
      << 100 * options.unit << "\n\t}\n}\nObjects:  {\n";
  std::vector<int> corners = rig.faces;
  for (std::size_t c = 2; c < corners.size(); c += 3) corners[c] = -corners[c] - 1;
  text
      << "Geometry: 1000, \"Geometry::body\", \"Mesh\" {\n"
      << array("Vertices", list(rig.vertices, ","), rig.vertices.size())
      << array("PolygonVertexIndex", list(corners, ","), corners.size())
      << "LayerElementMaterial: 0 {\n\tVersion: 101\n\tName: \"\"\n\tMappingInformationType: \"AllSame\"\n"
         "\tReferenceInformationType: \"IndexToDirect\"\n"
      << array("Materials", "0", 1)
      << "}\nLayer: 0 {\n\tVersion: 100\n\tLayerElement:  {\n\t\tType: \"LayerElementMaterial\"\n"
         "\t\tTypedIndex: 0\n\t}\n}\n}\n"
      << "Model: 2000, \"Model::body\", \"Mesh\" {\n\tVersion: 232\n\tProperties70:  {\n\t}\n}\n"
      << "Material: 6000, \"Material::skin\", \"\" {\n\tVersion: 102\n\tShadingModel: \"lambert\"\n\tProperties70:  {\n"
         "\t\tP: \"DiffuseColor\", \"Color\", \"\", \"A\",0.25,0.5,0.75\n\t}\n}\n";
  if (!options.diffuse_texture.empty()) {
    text << "Texture: 7000, \"Texture::picture\", \"\" {\n\tType: \"TextureVideoClip\"\n\tVersion: 202\n\tFileName: \""
         << options.diffuse_texture << "\"\n\tRelativeFilename: \"" << options.diffuse_texture << "\"\n}\n";
  }
  const auto joints = static_cast<std::size_t>(rig.joint_count());
  const double angle = options.pre_rotation * 3.14159265358979323846 / 180.0;
  for (std::size_t j = 0; j < joints; ++j) {
    const Eigen::Vector3d p = joint(rig, j);
    // Below joint 1 everything is written in its turned frame; the rig is a chain along z, which that keeps in place.
    text << "Model: " << 100 + j << ", \"Model::j" << j << "\", \"LimbNode\" {\n\tVersion: 232\n\tProperties70:  {\n"
         << "\t\tP: \"Lcl Translation\", \"Lcl Translation\", \"\", \"A\"," << triple(offset(rig, j), ",") << "\n";
    if (j == 1 && options.pre_rotation != 0.0) {
      text << "\t\tP: \"RotationActive\", \"bool\", \"\", \"\",1\n\t\tP: \"PreRotation\", \"Vector3D\", \"Vector\", "
              "\"\",0,0,"
           << options.pre_rotation << "\n";
    }
    text << "\t}\n}\n";
    std::vector<int> vertices;
    std::vector<float> weights;
    for (int v = 0; v < rig.vertex_count(); ++v) {
      const float weight = rig.skin[static_cast<std::size_t>(v * rig.skin_columns) + j];
      if (weight == 0.0f) continue;
      vertices.push_back(v);
      weights.push_back(weight);
    }
    // Transform takes the mesh into the joint, TransformLink the joint into the world; rows are columns here.
    const double c = j == 0 ? 1.0 : std::cos(angle), s = j == 0 ? 0.0 : std::sin(angle);
    text << "Deformer: " << 300 + j << ", \"SubDeformer::\", \"Cluster\" {\n\tVersion: 100\n";
    if (!vertices.empty()) {
      text << array("Indexes", list(vertices, ","), vertices.size())
           << array("Weights", list(weights, ","), weights.size());
    }
    text << array("Transform",
                  list(std::vector<double>{c, -s, 0, 0, s, c, 0, 0, 0, 0, 1, 0, -c * p.x() - s * p.y(),
                                           s * p.x() - c * p.y(), -p.z(), 1},
                       ","),
                  16)
         << array("TransformLink",
                  list(std::vector<double>{c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, p.x(), p.y(), p.z(), 1}, ","), 16)
         << "}\n";
  }
  text << "Deformer: 3000, \"Deformer::\", \"Skin\" {\n\tVersion: 101\n\tLink_DeformAcuracy: 50\n}\n";
  if (options.animated) {
    text << "AnimationStack: 5000, \"AnimStack::walk\", \"\" {\n}\nAnimationLayer: 5001, \"AnimLayer::base\", \"\" "
            "{\n}\n"
            "AnimationCurveNode: 5002, \"AnimCurveNode::R\", \"\" {\n\tProperties70:  {\n"
            "\t\tP: \"d|X\", \"Number\", \"\", \"A\",0\n\t\tP: \"d|Y\", \"Number\", \"\", \"A\",0\n"
            "\t\tP: \"d|Z\", \"Number\", \"\", \"A\",0\n\t}\n}\n"
            "AnimationCurve: 5003, \"AnimCurve::\", \"\" {\n\tDefault: 0\n\tKeyVer: 4008\n"
         << array("KeyTime", "0,46186158000", 2) << array("KeyValueFloat", "0,90", 2)
         << array("KeyAttrFlags", "24840", 1) << array("KeyAttrDataFloat", "0,0,0,0", 4)
         << array("KeyAttrRefCount", "2", 1) << "}\n";
  }
  text << "}\nConnections:  {\n\tC: \"OO\",2000,0\n\tC: \"OO\",1000,2000\n\tC: \"OO\",3000,1000\n"
          "\tC: \"OO\",6000,2000\n";
  if (!options.diffuse_texture.empty()) text << "\tC: \"OP\",7000,6000, \"DiffuseColor\"\n";
  for (std::size_t j = 0; j < joints; ++j) {
    text << "\tC: \"OO\"," << 100 + j << "," << (j == 0 ? 0 : 99 + j) << "\n\tC: \"OO\"," << 300 + j
         << ",3000\n\tC: \"OO\"," << 100 + j << "," << 300 + j << "\n";
  }
  if (options.animated) {
    text << "\tC: \"OO\",5001,5000\n\tC: \"OO\",5002,5001\n\tC: \"OP\",5002,101, \"Lcl Rotation\"\n"
            "\tC: \"OP\",5003,5002, \"d|X\"\n";
  }
  text << "}\n";
  return text.str();
}

}  // namespace anigen::test
