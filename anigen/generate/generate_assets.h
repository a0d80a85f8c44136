#pragma once
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/finishing.h"
#include "anigen/generate/picture_input.h"

namespace anigen::generate {

struct GenerateRequest {
  AssetGenerator::Request models;
  GenerationOptions sampling;
  std::filesystem::path voxels;             ///< voxels.npz of an earlier call, for one image; empty: none
  PreprocessingOptions pictures;            ///< their size is that of the models' conditions
  std::filesystem::path estimator_weights;  ///< for NormalSource::kEstimator
  FinishingOptions finishing;
  bool picture_colors = true;      ///< where the camera is known, see generate/picture_colors.h; else decoded colours
  bool published_axes = false;     ///< (−x, z, y) in the file, as the published exporter writes; else (x, z, −y)
  bool idle = true;                ///< mesh.glb moves: motions::idle_clip()
  bool obj = false;                ///< also mesh.obj and mesh.rig.json, see io/obj.h
  bool intermediate = false;       ///< also what the stages gave: voxels, latents, votes, the dense mesh; see also
                                   ///< GenerationOptions::voxels_alone
  bool again = false;              ///< also assets whose files are there
  bool accept_other_code = false;  ///< what is there counts whatever build of the program made it
  /// Folder; each asset gets one of its own, of the picture's name. Of generate_file() the file.
  std::filesystem::path output;
  std::string name;  ///< of the asset, for one picture; empty: the picture's
  /// Called before work on a picture begins. What it throws counts for that picture, as failure_of_item() says.
  std::function<void(const NamedPicture&)> started = nullptr;
};

/// Everything that decides what is made of a picture, with names, sizes and times of its files and the runs'.
/// @param runs AssetGenerator::runs()
Json generation_settings(const GenerateRequest& request, const std::vector<std::filesystem::path>& runs,
                         const NamedPicture& picture);

/// Outcome of one image.
struct GenerationReport {
  std::string name;
  std::filesystem::path folder;  ///< of generate_assets()
  std::filesystem::path file;    ///< of generate_file()
  std::string failure;           ///< empty: there is an asset
  bool kept = false;             ///< it was there already
  Json details;                  ///< as written to generation.json
};

/// Pictures to rigged GLB files, one for each or for the views of each (NamedPicture::others). For each
/// `<output>/<name>/`: mesh.glb, which idles, skeleton.glb, processed_image.png, processed_normal.png where normals
/// were seen, preview.png, and generation.json, written last: what made it (commit, runs, seed, options, notices,
/// times). With GenerationOptions::voxels_alone voxels.npz and voxels.png in place of the meshes and the preview. A
/// picture that fails, for whatever reason, is reported and does not stop the others. Several processes called alike
/// share the pictures by leases in <output>/.leases and all return at the end; with `again` each makes every picture.
/// @throws InputError when the models are unusable, two pictures have one name, or an asset that is there and would be
/// kept was made by another commit (core/version.h), unless the request says `again` or `accept_other_code`; before
/// any work, when a result would replace an input. WriteError when the disk refuses
std::vector<GenerationReport> generate_assets(const GenerateRequest& request,
                                              const std::vector<NamedPicture>& pictures);

/// One picture, or the views of one object, to one file in the format of its extension (io::is_rigged_output()), with
/// nothing beside it. A file that is there is replaced, unless the picture fails, which is reported.
/// @throws InputError when the models are unusable, for another extension, and for options whose results are other
/// files; before any work, when the file would replace an input
GenerationReport generate_file(const GenerateRequest& request, const NamedPicture& picture);

Json to_json(const std::vector<GenerationReport>& reports);
std::string to_text(const std::vector<GenerationReport>& reports);

}  // namespace anigen::generate
