#include <cstdio>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/library_versions.h"
#include "anigen/core/error.h"
#include "anigen/rig/rig_meshes.h"
#ifdef ANIGEN_WITH_TORCH
#include "anigen/nn/computing.h"
#include "anigen/pipeline/retrieve_assets.h"
#endif

namespace {

using namespace anigen;

struct RigOptions {
  std::string method, mesh, image, dataset, out, background = "auto", condition = "color";
  std::vector<std::string> splits, pictured;
  std::size_t views = 0, most = 0;
};

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

void place_template(const RigOptions& options, const CommonOptions& common) {
  if (options.mesh.empty()) throw InputError("", "--mesh", "the template is placed in meshes; name one or a folder");
  rig::RigRequest request;
  request.meshes = options.mesh;
  request.skeletons = options.dataset;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.out = options.out;
  const rig::RigReports reports = rig::rig_meshes(request);
  print(reports, common);
  require_one(reports.meshes, "meshes");
}

void retrieve(const RigOptions& options, const CommonOptions& common) {
#ifdef ANIGEN_WITH_TORCH
  if (options.image.empty() == options.pictured.empty())
    throw InputError("", "--image", "retrieval answers pictures: name one, a folder of them, or --picture-split");
  nn::set_up_computing(common.threads);
  pipeline::RetrievalRequest request;
  request.dataset = options.dataset;
  request.splits = {options.splits.begin(), options.splits.end()};
  request.views = options.views;
  request.pictures.background = pipeline::parse_background(options.background);
  request.seen =
      options.condition == "normal" ? loaders::ConditionPictures::kNormals : loaders::ConditionPictures::kColor;
  request.output = options.out;
  const auto pictures = options.image.empty()
                            ? pipeline::pictures_of_dataset(
                                  options.dataset, {options.pictured.begin(), options.pictured.end()}, options.most)
                            : pipeline::pictures_at(options.image);
  const auto reports = pipeline::retrieve_assets(request, pictures);
  print(reports, common);
  require_one(reports, "pictures");
#else
  static_cast<void>(common);
  throw NotSupportedError(options.dataset, "", "--method retrieval in a build without LibTorch");
#endif
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Rigs by a baseline method, to compare with.\n\n"
      "  anigen-rig --method template --mesh results/ --dataset data --split data/splits/train.txt --out template\n"
      "  anigen-rig --method retrieval --image photos/ --dataset data --split data/splits/train.txt --out retrieved\n"};
  CommonOptions common;
  RigOptions options;
  app.add_option("--method", options.method,
                 "template: the data set's middle skeleton in the mesh's box, vertices bound to the nearest bone; "
                 "retrieval: the data set's asset whose condition view is most like the picture")
      ->required()
      ->check(CLI::IsMember({"template", "retrieval"}));
  app.add_option("--mesh", options.mesh, "For template: file or folder; rigs in it are ignored");
  app.add_option("--image", options.image, "For retrieval: picture, or folder of pictures");
  app.add_option("--picture-split", options.pictured,
                 "For retrieval, instead of --image: the first condition view of these assets of --dataset");
  app.add_option("--most", options.most, "Only so many assets of --picture-split; 0: all");
  app.add_option("--dataset", options.dataset, "Where skeletons and answers come from")->required();
  app.add_option("--split", options.splits, "Files of the ids to use; without, everything");
  app.add_option("--views", options.views, "For retrieval: condition views to look at per asset, 0: all")
      ->capture_default_str();
  app.add_option("--background", options.background, "For retrieval: auto, keep, alpha, grabcut, as anigen-generate")
      ->capture_default_str();
  app.add_option("--condition", options.condition,
                 "For retrieval: what is compared, color, or normal: the maps of --view-geometry, with --picture-split")
      ->capture_default_str()
      ->check(CLI::IsMember({"color", "normal"}));
  app.add_option("--out", options.out, "Folder; for template and one mesh the file")->required();
  add_common_options(app, common, library_versions());
  return run_command(app, common, argc, argv, [&] {
    options.method == "template" ? place_template(options, common) : retrieve(options, common);
  });
}
