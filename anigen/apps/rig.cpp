#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/apps/rig_arguments.h"
#include "anigen/core/error.h"
#include "anigen/engine/rig_request.h"
#include "anigen/eval/describe.h"
#include "anigen/io/image.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"

namespace {

using namespace anigen;

/// @throws InputError naming the option of a trained model that is not there
void require_models(const RigArguments& options) {
  const std::pair<const char*, const std::string&> models[] = {{"--joint-model", options.joint_model},
                                                               {"--connectivity-model", options.connectivity_model},
                                                               {"--skin-model", options.skin_model},
                                                               {"--skin-run", options.skin_run}};
  for (const auto& [option, path] : models) {
    if (!path.empty() && !std::filesystem::exists(path))
      throw InputError(path, option, "there is no such file or folder");
  }
}

/// The extension of a file says its format already. @throws InputError where --format says another
void refuse_format_of_file(const RigArguments& options) {
  const std::filesystem::path& out = options.request.out;
  if (!io::is_rigged_output(out)) return;  // a folder, of the shapes that one file holds
  if (!io::has_extension(out, {"." + options.format}))
    throw InputError(out.string(), "--format", "the file's extension says another format than " + options.format);
}

/// Options of what no model does.
engine::RigOptions classical_options(const RigArguments& options, bool learned) {
  engine::RigOptions rig = options.rig;
  const bool fields = rig.method == kAnigen;
  if (learned) rig.method = fields ? "auto" : "geovoxel";
  if (fields) rig.learned_joints = rig.keep_skeleton = false;  // its joints are new ones, of each body
  if (rig.skin == kLearnedSkin) rig.skin.clear();
  if (options.rigid_parts) rig.rigid_share = options.rigid_share;
  return rig;
}

void rig_files(RigArguments& options, const CommonOptions& common) {
  const std::string& method = options.rig.method;
  const bool learned = method == kAnigen || method == kAnymate || method == kRignet;
  rigging::RigRequest& request = options.request;
  request.engine.humanoid = io::has_extension(request.out, {".vrm"});
  request = engine::rig_request(classical_options(options, learned), request);
  request.meshes = options.mesh;
  if (!options.format.empty()) {
    request.format = options.format;
    if (std::filesystem::is_regular_file(options.mesh)) refuse_format_of_file(options);
  }
  request.graft = !options.no_graft;
  request.axes = io::parse_axes(options.mesh_up);
  request.also_read = {options.joint_model, options.connectivity_model, options.skin_model, options.skin_run};
  if (options.preview) {
    request.also_writes = ".png";
    request.also = [](const Asset& asset, std::filesystem::path file) {
      io::write_png(file.replace_extension(".png"), eval::asset_picture(asset));
    };
  }
  if (learned) request.learned = torch_half("trained models").learned_steps(options, common);
  if (options.rig.skin == kLearnedSkin)
    request.learned.bind = torch_half("--skin learned").learned_skin(options, common).bind;
  const rigging::RigReports reports = rigging::rig_meshes(request);
  print_result(to_json(reports), to_text(reports), common);
  require_inputs(reports.meshes, "meshes gave no rig", common);
}

void add_mesh_options(CLI::App& app, RigArguments& options) {
  rigging::RigRequest& request = options.request;
  add_option(app, "--mesh", options.mesh);
  add_option(app, "--mesh-split", request.splits);
  add_option(app, "--mesh-up", options.mesh_up);
  add_option(app, "--skin", options.rig.skin);
  add_option(app, "--skeleton", request.joints.skeleton);
  add_switch_off(app, "--new-skeleton", options.rig.keep_skeleton);
  add_option(app, "--template", options.rig.templates)->check(one_of(rigging::template_words()));
  add_option(app, "--joints", options.rig.joints)->check(whole_number(0, 1000));
  add_option(app, "--symmetric", options.rig.symmetric);
  add_option(app, "--add-joints", options.rig.add_joints);
  add_switch_off(app, "--one-body", options.rig.separate_bodies);
  add_option(app, "--geovoxel-resolution", request.binding.geodesic.resolution)->check(whole_number(2, 512));
  add_option(app, "--falloff", request.binding.geodesic.falloff)->check(number(0, 1));
  add_option(app, "--curve-joints", request.joints.curve.most_joints)->check(whole_number(2, 10'000));
  add_option(app, "--influences", options.rig.influences, "; 0: any number")->check(whole_number(0, 1024));
  CLI::Option* rigid = add_option(app, "--rigid-parts", options.rigid_parts);
  add_option(app, "--rigid-share", options.rigid_share)->check(number(0.5, 1, RangeEnds::kOpenBelow))->needs(rigid);
  add_option(app, "--no-graft", options.no_graft);
  add_option(app, "--format", options.format);
  add_option(app, "--preview", options.preview);
}

void add_engine_options(CLI::App& app, RigArguments& options) {
  add_option(app, "--bone-axes", options.rig.bone_axes);
  add_option(app, "--height", options.rig.height)->check(number(0, 100'000, RangeEnds::kOpenBelow))->default_str("");
  add_option(app, "--ground", options.rig.ground);
  add_option(app, "--root-bone", options.rig.root_bone);
  add_option(app, "--names", options.rig.names);
  add_option(app, "--author", options.request.vrm.authors);
  add_option(app, "--copyright", options.request.vrm.copyright);
}

void add_model_options(CLI::App& app, RigArguments& options) {
  add_option(app, "--joint-model", options.joint_model);
  add_option(app, "--connectivity-model", options.connectivity_model);
  add_option(app, "--skin-model", options.skin_model);
  add_option(app, "--skin-run", options.skin_run,
             ", for --skin learned [skin_correction of the weights that are found]");
  add_option(app, "--points", options.points)->check(whole_number(1, 10'000'000))->default_str("");
  add_option(app, "--joint-distance", options.joint_distance)
      ->check(number(0, 2, RangeEnds::kOpenBelow))
      ->default_str("");
}

void add_dataset_options(CLI::App& app, RigArguments& options) {
  add_option(app, "--dataset", options.request.joints.collection,
             ": for template and retrieval, source of skeletons and answers");
  add_option(app, "--split", options.request.joints.splits);
  add_option(app, "--image", options.image, ": for retrieval");
  CLI::Option* asked = add_option(app, "--image-split", options.image_splits);
  add_option(app, "--image-dataset", options.image_dataset)->needs(asked);
  add_option(app, "--limit", options.limit, ", of --image-split")->check(whole_number(0));
  add_option(app, "--retrieval-views", options.views, "; 0: all")->check(whole_number(0, 1000));
  add_option(app, "--retrieval-encoder", options.retrieval_encoder);
  add_option(app, "--background", options.background, ", as anigen-generate; for retrieval")
      ->check(one_of({"auto", "keep", "alpha", "grabcut"}));
  add_option(app, "--condition", options.condition,
             "; for retrieval: normal needs --image-split and the maps of --view-geometry")
      ->check(one_of({"color", "normal"}));
}

/// Options that another method would use, or that others leave without effect.
void refuse_ignored(const CLI::App& app, const RigArguments& options) {
  const std::string& method = options.rig.method;
  const std::string whose = "is not used by --method " + method;
  if (method == "retrieval") {
    refuse_given(app, {"--mesh",       "--mesh-split",   "--mesh-up",     "--skin",
                       "--skeleton",   "--new-skeleton", "--template",    "--geovoxel-resolution",
                       "--falloff",    "--curve-joints", "--influences",  "--no-graft",
                       "--format",     "--preview",      "--joint-model", "--connectivity-model",
                       "--skin-model", "--skin-run",     "--points",      "--joint-distance",
                       "--seed",       "--bone-axes",    "--height",      "--ground",
                       "--root-bone",  "--names",        "--author",      "--copyright",
                       "--joints",     "--symmetric",    "--add-joints",  "--one-body",
                       "--rigid-parts"},
                 whose + ", which answers images");
    if (options.image_splits.empty()) refuse_given(app, {"--limit"}, "applies only to the assets of --image-split");
    if (options.retrieval_encoder.empty()) {
      refuse_given(app, {"--device"}, whose + " without --retrieval-encoder");
    } else {
      refuse_given(app, {"--condition"}, "is that of the flow of --retrieval-encoder");
    }
    return;
  }
  refuse_given(app,
               {"--image", "--image-split", "--image-dataset", "--limit", "--retrieval-views", "--retrieval-encoder",
                "--background", "--condition"},
               whose + "; it applies to retrieval");
  const bool is_vrm = io::has_extension(options.request.out, {".vrm"});
  if (is_vrm && options.rig.skin == "none")
    throw InputError("", "--output", "a .vrm needs weights, and --skin none writes the skeleton alone");
  if (!is_vrm) refuse_given(app, {"--author", "--copyright"}, "applies only to a .vrm, and --output is another file");
  const bool fields = method == kAnigen;
  const bool trained = method == kAnymate || method == kRignet;
  if (!trained)
    refuse_given(app, {"--connectivity-model", "--skin-model"}, whose + "; it applies to anymate and rignet");
  if (!trained && !fields) {
    refuse_given(app, {"--joint-model"}, whose + "; it applies to anigen, anymate and rignet");
    refuse_given(app, {"--seed"}, whose + ", which draws nothing at random");
    refuse_given(app, {"--device"}, whose + ", which computes on the CPU");
  }
  if (method != kAnymate) refuse_given(app, {"--points", "--joint-distance"}, whose + "; it applies to anymate");
  if (options.joint_model.empty()) refuse_given(app, {"--joint-distance"}, "merges the joints of --joint-model");
  if (method != "template")
    refuse_given(app, {"--dataset", "--split"}, whose + "; it applies to template and retrieval");
  const bool automatic = method == "auto";
  if (method != "curve" && !automatic) refuse_given(app, {"--curve-joints"}, whose + "; it applies to curve and auto");
  if (method != "pinocchio" && !automatic)
    refuse_given(app, {"--template"}, whose + "; it applies to pinocchio and auto");
  if (!automatic) refuse_given(app, {"--new-skeleton"}, whose + "; it applies to auto");
  if (!automatic && !fields) refuse_given(app, {"--one-body"}, whose + "; it applies to auto and anigen");
  if (!automatic && method != "nearest" && method != "geovoxel" && method != "heat")
    refuse_given(app, {"--add-joints"}, whose + ", which makes the skeleton itself");
  if (!options.rig.keep_skeleton)
    refuse_given(app, {"--add-joints"}, "adds to the skeleton that --new-skeleton leaves out");
  if (method == "curve" || method == "template" || fields)
    refuse_given(app, {"--skeleton"}, whose + ", which makes the skeleton itself");
  if (options.rig.skin != kLearnedSkin) refuse_given(app, {"--skin-run"}, "corrects weights for --skin learned alone");
  if (options.rig.skin == "none")
    refuse_given(app, {"--no-graft", "--rigid-parts"}, "has no effect where the skeleton alone is written");
  if (!options.joint_model.empty()) refuse_given(app, {"--skeleton"}, "--joint-model finds the joints");
  if (!options.request.joints.skeleton.empty() && automatic) {
    refuse_given(app, {"--new-skeleton", "--template", "--curve-joints"}, "--skeleton has the joints already");
  } else if (!options.request.joints.skeleton.empty()) {
    refuse_given(app, {"--template"}, "--skeleton is the template already");
  }
  if (!options.skin_model.empty()) {
    refuse_given(app, {"--geovoxel-resolution", "--falloff"}, "applies to geovoxel, and --skin-model binds");
    return;
  }
  std::string binding = options.rig.skin;
  if (binding.empty()) {
    binding = method == "nearest" || method == "template"                        ? "nearest"
              : method == "heat" || method == "pinocchio" || automatic || fields ? "heat"
                                                                                 : "geovoxel";
  }
  if (binding != "geovoxel")
    refuse_given(app, {"--geovoxel-resolution", "--falloff"}, "applies to geovoxel, and the binding is " + binding);
  if (binding == "none" || binding == "nearest")
    refuse_given(app, {"--influences"}, "has no effect where the binding is " + binding);
}

void require_inputs_of_retrieval(const RigArguments& options) {
  if (options.request.joints.collection.empty())
    throw InputError("", "--dataset", "retrieval answers with an asset of a dataset; name one");
  if (options.image.empty() == options.image_splits.empty())
    throw InputError("", "--image", "retrieval answers images: name one, a folder of them, or --image-split");
}

void require_inputs_of_rigging(const RigArguments& options) {
  const std::string& method = options.rig.method;
  if (options.mesh.empty()) throw InputError("", "--mesh", "name the mesh to rig, or a folder of them");
  if (method == "template" && options.request.joints.collection.empty())
    throw InputError("", "--dataset", "the template is the middle skeleton of a collection; name one");
  if (method != kAnymate && method != kRignet) return;
  if ((options.joint_model + options.connectivity_model + options.skin_model).empty())
    throw InputError("", "--joint-model", "name a trained model: this one, --connectivity-model or --skin-model");
  if (!options.skin_model.empty() && !options.rig.skin.empty())
    throw InputError("", "--skin", "--skin-model binds already; leave out one of the two");
}

}  // namespace

int main(int argc, char** argv) {
  Program program(
      "anigen-rig", "Rigs meshes by classical methods, by our flows, or by models of Anymate or RigNet.",
      "  anigen-rig statue.glb -o rigged.glb --preview\n"
      "  anigen-rig statue.glb -o rigged.fbx\n"
      "  anigen-rig cat.glb --method anigen -o rigged.glb\n"
      "  anigen-rig --method curve -m meshes/ -o rigged/ --format usdz\n"
      "  anigen-rig dog.glb --joints 24 --symmetric -o dog_24.glb\n"
      "  anigen-rig hero.glb --height 1.8 --ground --names unreal --root-bone -o hero_unreal.glb\n"
      "  anigen-rig hero.glb --author \"A. Name\" -o hero.vrm\n"
      "  anigen-rig --method geovoxel -m body.glb --skeleton rig.glb -o rigged.glb\n"
      "  anigen-rig --method heat -m rigs/ --skin learned --skin-run runs/skin_correction -o bound/\n"
      "  anigen-rig --method anymate -m meshes/ --joint-model runs/joints --skin-model runs/skin -o rigged/\n"
      "  anigen-rig --method rignet -m body.glb --joint-model runs/rignet_joints -o rigged.glb\n"
      "  anigen-rig --method template -m results/ -d data --split data/splits/train.txt -o template\n"
      "  anigen-rig --method retrieval -i photos/ -d data --split data/splits/train.txt -o retrieved");
  program.first = "--mesh";
  CLI::App& app = program.app;
  RigArguments options;
  std::vector<std::string> methods = rigging::rigging_method_words();
  methods.insert(methods.end(), {"retrieval", kAnigen, kAnymate, kRignet});
  add_option(app, "--method", options.rig.method,
             ". auto: the mesh's own joints, or else those of anigen where they are sure, or else a template that "
             "fits, or else the mesh's curve, bound by heat; "
             "nearest, geovoxel, heat: bind a mesh to the skeleton it has, or to --skeleton, by the nearest bone, by "
             "paths through its inside, or by heat; pinocchio: embed a template, bind by heat; curve: joints along "
             "the curve that the mesh contracts to, bound by geovoxel; template: the dataset's middle skeleton in "
             "the mesh's box, bound by nearest; retrieval: the dataset's asset whose condition view is most like "
             "the image; anigen: joints by trained flows that see the mesh, bound by heat; anymate, rignet: joints, "
             "their tree and weights by trained models, or only some of these")
      ->check(one_of(methods));
  add_mesh_options(app, options);
  add_engine_options(app, options);
  add_model_options(app, options);
  add_dataset_options(app, options);
  add_option(app, "--output", options.request.out,
             ": folder; for one mesh the file: .glb, .gltf, .fbx, .usdz, .usda or, of a humanoid, .vrm")
      ->required();
  program.add_common({"--keep-going", "--seed [0]", "--threads", "--device", "--json"}, library_versions());
  program.check = [&] {
    refuse_ignored(app, options);
    options.rig.method == "retrieval" ? require_inputs_of_retrieval(options) : require_inputs_of_rigging(options);
  };
  return program.run(argc, argv, [&] {
    require_models(options);
    options.rig.method == "retrieval" ? torch_half("retrieval").retrieve(options, program.common)
                                      : rig_files(options, program.common);
  });
}
