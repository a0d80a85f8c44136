#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/rig_arguments.h"
#include "anigen/core/error.h"
#include "anigen/eval/describe.h"
#include "anigen/io/image.h"
#include "anigen/rigging/rig_meshes.h"

namespace {

using namespace anigen;

template <typename Reports>
void print(const Reports& reports, const CommonOptions& common) {
  std::fputs(common.json ? (to_json(reports).dump(2) + "\n").c_str() : to_text(reports).c_str(), stdout);
}

/// @param each with a `failure`
template <typename Reports>
void require_one(const Reports& each, const char* what) {
  for (const auto& report : each) {
    if (report.failure.empty()) return;
  }
  throw Error(std::string("none of the ") + what + " could be rigged");
}

/// Lets trained models do what there are models for.
void use_models(RigArguments& options, const CommonOptions& common) {
  if (options.joint_model.empty() && options.connectivity_model.empty() && options.skin_model.empty())
    throw InputError("", "--joint-model", "name a trained model: this one, --connectivity-model or --skin-model");
  if (!options.skin_model.empty() && !options.skin.empty())
    throw InputError("", "--skin", "--skin-model binds already; leave out one of the two");
  options.request.learned = torch_half("trained models").learned_steps(options, common);
}

void rig_files(RigArguments& options, const CommonOptions& common) {
  rigging::RigRequest& request = options.request;
  const bool learned = options.method == kAnymate || options.method == kRignet;
  if (!learned && !(options.joint_model + options.connectivity_model + options.skin_model).empty())
    throw InputError("", "--method",
                     "only anymate and rignet use --joint-model, --connectivity-model and --skin-model");
  // Fallback method where no model is given.
  request.method = rigging::parse_rigging_method(learned ? "geovoxel" : options.method, options.skin);
  if (options.mesh.empty()) throw InputError("", "--mesh", "name the mesh to rig, or a folder of them");
  if (request.method.joints == rigging::JointSource::kTemplate && request.joints.collection.empty())
    throw InputError("", "--dataset", "the template is the middle skeleton of a collection; name one");
  request.meshes = options.mesh;
  request.axes = io::parse_axes(options.axes);
  request.also_read = {options.joint_model, options.connectivity_model, options.skin_model};
  if (options.pictures) {
    request.also_writes = ".png";
    request.also = [](const Asset& asset, std::filesystem::path file) {
      io::write_png(file.replace_extension(".png"), eval::asset_picture(asset));
    };
  }
  if (learned) use_models(options, common);
  const rigging::RigReports reports = rigging::rig_meshes(request);
  print(reports, common);
  require_one(reports.meshes, "meshes");
}

void retrieve(const RigArguments& options, const CommonOptions& common) {
  if (options.request.joints.collection.empty())
    throw InputError("", "--dataset", "retrieval answers with an asset of a data set; name one");
  if (options.image.empty() == options.pictured.empty())
    throw InputError("", "--image", "retrieval answers pictures: name one, a folder of them, or --picture-split");
  torch_half("retrieval").retrieve(options, common);
}

void add_mesh_options(CLI::App& app, RigArguments& options) {
  rigging::RigRequest& request = options.request;
  app.add_option("--mesh", options.mesh,
                 "File or folder of what to rig: .glb .gltf .fbx .dae .obj .ply, NPZ rigs, data sets");
  app.add_option("--mesh-split", request.splits, "Only the meshes whose ids these files list [all]");
  app.add_option("--mesh-axes", options.axes, "Up axis of the meshes: format, y-up, z-up")->capture_default_str();
  app.add_option("--skin", options.skin,
                 "How to bind, other than the method does: nearest, geovoxel, heat; none: the skeleton alone")
      ->check(CLI::IsMember({"nearest", "geovoxel", "heat", "none"}));
  app.add_option(
      "--skeleton", request.joints.skeleton,
      "A rig with the joints to bind to, placed in the mesh [the mesh file's own]; for pinocchio the template");
  app.add_option("--template", request.joints.templates,
                 "For pinocchio: biped, quadruped; of several the one that fits best [both]")
      ->check(CLI::IsMember(rigging::template_words()));
  app.add_option("--resolution", request.binding.geodesic.resolution,
                 "For geovoxel: voxels along the mesh's longest side")
      ->check(whole_number(2, 512))
      ->capture_default_str();
  app.add_option("--falloff", request.binding.geodesic.falloff,
                 "For geovoxel: from weights like 1/d² (0) to weights like 1/d⁴ (1)")
      ->check(number(0, 1))
      ->capture_default_str();
  app.add_option("--most-joints", request.joints.curve.most_joints, "For curve: no more joints than these")
      ->check(whole_number(2, 10'000))
      ->capture_default_str();
  app.add_option_function<std::size_t>(
         "--influences",
         [&request](std::size_t most) {
           request.binding.geodesic.most_influences = request.binding.heat.most_influences = most;
         },
         "Joints per vertex, 0: any number")
      ->check(whole_number(0, 1024))
      ->default_str(std::to_string(request.binding.heat.most_influences));
  app.add_flag("--pictures", options.pictures, "Also <name>.png: the asset, its weights, its skeleton");
}

void add_model_options(CLI::App& app, RigArguments& options) {
  app.add_option(
         "--joint-model", options.joint_model,
         "For anymate and rignet: a run folder of anigen-train, or a .safetensors file of one; for anymate also a "
         "checkpoint as released [given joints]")
      ->check(CLI::ExistingPath);
  app.add_option("--connectivity-model", options.connectivity_model,
                 "For both, likewise [the shortest tree through predicted joints; given joints keep theirs]")
      ->check(CLI::ExistingPath);
  app.add_option("--skin-model", options.skin_model, "For both, likewise [as --skin says, or geovoxel]")
      ->check(CLI::ExistingPath);
  app.add_option("--points", options.points,
                 "For anymate: points of the surface that the models look at [as in training; released: 8192]")
      ->check(whole_number(1, 10'000'000));
  app.add_option("--eps", options.eps,
                 "For anymate: predicted joints this near are one, the mesh's longest side being 2 [as released: 0.03 "
                 "regressed, 0.05 denoised; without meaning for volumes]")
      ->check(number(0, 2, RangeEnds::kOpenBelow));
}

void add_dataset_options(CLI::App& app, RigArguments& options) {
  app.add_option("--dataset", options.request.joints.collection,
                 "For template and retrieval: where skeletons and answers come from");
  app.add_option("--split", options.request.joints.splits, "Files of the ids to use; without, everything");
  app.add_option("--image", options.image, "For retrieval: picture, or folder of pictures");
  app.add_option("--picture-split", options.pictured,
                 "For retrieval, instead of --image: the first condition view of these assets of --dataset");
  app.add_option("--most", options.most, "Only so many assets of --picture-split; 0: all")->check(whole_number(0));
  app.add_option("--views", options.views, "For retrieval: condition views to look at per asset, 0: all")
      ->check(whole_number(0, 1000))
      ->capture_default_str();
  app.add_option("--background", options.background, "For retrieval: auto, keep, alpha, grabcut, as anigen-generate")
      ->capture_default_str();
  app.add_option("--condition", options.condition,
                 "For retrieval: what is compared, color, or normal: the maps of --view-geometry, with --picture-split")
      ->capture_default_str()
      ->check(CLI::IsMember({"color", "normal"}));
}

/// Options that another method would use, or that others leave without effect.
void refuse_ignored(const CLI::App& app, const RigArguments& options) {
  const std::string& method = options.method;
  const std::string whose = "is not used by --method " + method;
  if (method == "retrieval") {
    refuse_given(app,
                 {"--mesh", "--mesh-split", "--mesh-axes", "--skin", "--skeleton", "--template", "--resolution",
                  "--falloff", "--most-joints", "--influences", "--pictures", "--joint-model", "--connectivity-model",
                  "--skin-model", "--points", "--eps", "--seed", "--device"},
                 whose + ", which answers pictures");
    if (options.pictured.empty()) refuse_given(app, {"--most"}, "is of the assets of --picture-split");
    return;
  }
  refuse_given(app, {"--image", "--picture-split", "--most", "--views", "--background", "--condition"},
               whose + "; it is for retrieval");
  const bool learned = method == kAnymate || method == kRignet;
  if (!learned) {
    refuse_given(app, {"--joint-model", "--connectivity-model", "--skin-model"},
                 whose + "; it is for anymate and rignet");
    refuse_given(app, {"--seed"}, whose + ", which draws nothing at random");
    refuse_given(app, {"--device"}, whose + ", which computes on the CPU");
  }
  if (method != kAnymate) refuse_given(app, {"--points", "--eps"}, whose + "; it is for anymate");
  if (options.joint_model.empty()) refuse_given(app, {"--eps"}, "merges the joints of --joint-model");
  if (method != "template") refuse_given(app, {"--dataset", "--split"}, whose + "; it is for template and retrieval");
  if (method != "curve") refuse_given(app, {"--most-joints"}, whose + "; it is for curve");
  if (method != "pinocchio") refuse_given(app, {"--template"}, whose + "; it is for pinocchio");
  if (method == "curve" || method == "template")
    refuse_given(app, {"--skeleton"}, whose + ", which makes the skeleton itself");
  if (!options.joint_model.empty()) refuse_given(app, {"--skeleton"}, "--joint-model finds the joints");
  if (!options.request.joints.skeleton.empty()) refuse_given(app, {"--template"}, "--skeleton is the template already");
  if (!options.skin_model.empty()) {
    refuse_given(app, {"--resolution", "--falloff"}, "is for geovoxel, and --skin-model binds");
    return;
  }
  std::string binding = options.skin;
  if (binding.empty()) {
    binding = method == "nearest" || method == "template" ? "nearest"
              : method == "heat" || method == "pinocchio" ? "heat"
                                                          : "geovoxel";
  }
  if (binding != "geovoxel")
    refuse_given(app, {"--resolution", "--falloff"}, "is for geovoxel, and the binding is " + binding);
  if (binding == "none" || binding == "nearest")
    refuse_given(app, {"--influences"}, "has no effect where the binding is " + binding);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Rigs meshes by methods that learned nothing, or by models of Anymate or RigNet, to use or to compare with.\n\n"
      "  anigen-rig --method pinocchio --mesh statue.glb --out rigged.glb --pictures\n"
      "  anigen-rig --method curve --mesh meshes/ --out rigged/\n"
      "  anigen-rig --method geovoxel --mesh body.glb --skeleton rig.glb --out rigged.glb\n"
      "  anigen-rig --method anymate --mesh meshes/ --joint-model runs/joints --skin-model runs/skin --out rigged/\n"
      "  anigen-rig --method rignet --mesh body.glb --joint-model runs/rignet_joints --out rigged.glb\n"
      "  anigen-rig --method template --mesh results/ --dataset data --split data/splits/train.txt --out template\n"
      "  anigen-rig --method retrieval --image photos/ --dataset data --split data/splits/train.txt --out retrieved\n"};
  CommonOptions common;
  RigArguments options;
  std::vector<std::string> methods = rigging::rigging_method_words();
  methods.emplace_back("retrieval");
  methods.emplace_back(kAnymate);
  methods.emplace_back(kRignet);
  app.add_option(
         "--method", options.method,
         "nearest, geovoxel, heat: bind a mesh to the skeleton it has, or to --skeleton, by the nearest bone, by "
         "paths through its inside, or by heat; pinocchio: embed a template, bind by heat; curve: joints along "
         "the curve that the mesh contracts to, bound by geovoxel; template: the data set's middle skeleton in "
         "the mesh's box, bound by nearest; retrieval: the data set's asset whose condition view is most like "
         "the picture; anymate, rignet: joints, their tree and weights by trained models, or only some of these")
      ->required()
      ->check(CLI::IsMember(methods));
  add_mesh_options(app, options);
  add_model_options(app, options);
  add_dataset_options(app, options);
  app.add_option("--out", options.request.out, "Folder; for one mesh the file")->required();
  add_common_options(app, common, library_versions());
  return run_command(app, common, argc, argv, [&] {
    refuse_ignored(app, options);
    options.method == "retrieval" ? retrieve(options, common) : rig_files(options, common);
  });
}
