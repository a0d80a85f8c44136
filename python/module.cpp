// The Python module `anigen._anigen`: anigen/anigen.h with numpy arrays. Long calls release the interpreter's lock.
#include <pybind11/functional.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "anigen/anigen.h"
#include "python/calls.h"

namespace py = pybind11;
using namespace anigen;
using anigen::python::ProgressFunction;
using anigen::python::unlocked;
using anigen::python::WatchedCall;

namespace {

using AssetPtr = std::shared_ptr<Asset>;
using Floats = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Integers = py::array_t<std::int32_t, py::array::c_style>;
using WideIntegers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float), "vertices are packed");
static_assert(sizeof(Triangle) == 3 * sizeof(std::int32_t), "faces are packed");

/// A view of rows of `columns` numbers that keeps the asset alive. Writing to it changes the asset.
template <typename Number, typename Row>
py::array view_of(const std::vector<Row>& rows, std::size_t columns, const py::object& owner) {
  return py::array_t<Number>({rows.size(), columns}, reinterpret_cast<const Number*>(rows.data()), owner);
}

/// @throws InputError unless the array is [any, columns]
void require_columns(const py::array& array, py::ssize_t columns, const std::string& name) {
  if (array.ndim() == 2 && array.shape(1) == columns) return;
  std::string shape;
  for (py::ssize_t i = 0; i < array.ndim(); ++i) shape += (i > 0 ? ", " : "") + std::to_string(array.shape(i));
  throw InputError("", name, "has shape (" + shape + "), expected (any, " + std::to_string(columns) + ")");
}

/// An array of what the caller gave. An empty one may have any type: numpy gives [] one of its own.
/// @param kinds letters of numpy's kinds of types
/// @throws InputError for another kind: a conversion drops imaginary parts and fractions without a word
py::array array_in(const py::object& given, const char* kinds, const char* expected, const std::string& name) {
  py::array array(given);
  if (array.size() > 0 && std::strchr(kinds, array.dtype().kind()) == nullptr)
    throw InputError("", name,
                     "has elements of type " + std::string(py::str(array.dtype())) + ", expected " + expected);
  return array;
}

template <typename Reals>
Reals reals_in(const py::object& given, const std::string& name) {
  return Reals(array_in(given, "fiub", "real numbers", name));
}

/// @throws InputError naming the first row with a number that int32 does not hold
Integers integers_in(const py::object& given, const std::string& name) {
  const py::array array = array_in(given, "iu", "integers", name);
  const bool natural = array.dtype().kind() == 'u';
  const WideIntegers wide(array);
  Integers narrow(std::vector<py::ssize_t>(array.shape(), array.shape() + array.ndim()));
  std::int32_t* const result = narrow.mutable_data();
  for (py::ssize_t i = 0; i < wide.size(); ++i) {
    const std::int64_t value = wide.data()[i];
    // Numbers of uint64 from 2^63 on are negative as int64.
    const bool wrapped = natural && value < 0;
    if (wrapped || value < std::numeric_limits<std::int32_t>::min() ||
        value > std::numeric_limits<std::int32_t>::max()) {
      const py::ssize_t row = array.ndim() > 0 ? i / (array.size() / array.shape(0)) : 0;
      const std::string text = wrapped ? std::to_string(static_cast<std::uint64_t>(value)) : std::to_string(value);
      throw InputError("", name, "row " + std::to_string(row) + " has " + text + ", which int32 does not hold");
    }
    result[i] = static_cast<std::int32_t>(value);
  }
  return narrow;
}

std::vector<int> parents_in(const py::object& given, const std::string& name) {
  const Integers parents = integers_in(given, name);
  if (parents.ndim() != 1)
    throw InputError("", name, "has " + std::to_string(parents.ndim()) + " dimensions, expected 1");
  return {parents.data(), parents.data() + parents.size()};
}

/// @param which the end of the arguments' names, such as "_a"
JointTree tree_in(const py::object& given_joints, const py::object& parents, const std::string& which = "") {
  const auto joints = reals_in<Doubles>(given_joints, "joints" + which);
  require_columns(joints, 3, "joints" + which);
  JointTree tree;
  tree.parents = parents_in(parents, "parents" + which);
  for (py::ssize_t j = 0; j < joints.shape(0); ++j)
    tree.positions.emplace_back(joints.at(j, 0), joints.at(j, 1), joints.at(j, 2));
  return tree;
}

/// Rows without a weight pass, as files have them: such vertices follow the root.
/// @throws InputError naming the first row with a weight below 0 or not finite
void require_weights(const Floats& skin) {
  const auto weights = skin.unchecked<2>();
  for (py::ssize_t v = 0; v < weights.shape(0); ++v) {
    for (py::ssize_t j = 0; j < weights.shape(1); ++j) {
      const float weight = weights(v, j);
      if (!std::isfinite(weight) || weight < 0.0F)
        throw InputError("", "skin", "row " + std::to_string(v) + " has a weight that is below 0 or not finite");
    }
  }
}

AssetPtr from_arrays(const py::object& given_vertices, const py::object& given_faces, const py::object& given_joints,
                     const py::object& given_parents, const py::object& given_skin,
                     const std::vector<std::string>& names) {
  const auto vertices = reals_in<Floats>(given_vertices, "vertices");
  const Integers faces = integers_in(given_faces, "faces");
  const std::vector<int> parents = parents_in(given_parents, "parents");
  const bool has_joints = !given_joints.is_none(), has_skin = !given_skin.is_none();
  require_columns(vertices, 3, "vertices");
  require_columns(faces, 3, "faces");
  auto asset = std::make_shared<Asset>();
  asset->mesh.vertices.resize(static_cast<std::size_t>(vertices.shape(0)));
  if (vertices.size() > 0)
    std::memcpy(asset->mesh.vertices.data()->data(), vertices.data(), static_cast<std::size_t>(vertices.nbytes()));
  asset->mesh.faces.resize(static_cast<std::size_t>(faces.shape(0)));
  if (faces.size() > 0) std::memcpy(asset->mesh.faces.data(), faces.data(), static_cast<std::size_t>(faces.nbytes()));
  if (has_joints) {
    const JointTree tree = tree_in(given_joints, given_parents);
    check(tree, "joints");
    asset->skeleton = skeleton_from_joints(tree.positions, parents, names);
  }
  if (has_skin) {
    const auto skin = reals_in<Floats>(given_skin, "skin");
    require_columns(skin, static_cast<py::ssize_t>(parents.size()), "skin");
    if (skin.shape(0) != vertices.shape(0))
      throw InputError(
          "", "skin",
          "has " + std::to_string(skin.shape(0)) + " rows for " + std::to_string(vertices.shape(0)) + " vertices");
    require_weights(skin);
    asset->skin =
        from_dense({skin.data(), skin.data() + skin.size()}, static_cast<std::size_t>(skin.shape(0)), parents.size());
  }
  const std::vector<std::string> findings = validate(*asset, 1, has_joints && has_skin);
  if (!findings.empty()) throw InputError("", "arrays", findings.front());
  return asset;
}

py::array_t<double> joints_of(const Asset& asset) {
  const std::vector<Eigen::Vector3d> positions = asset.skeleton.positions();
  py::array_t<double> joints({positions.size(), std::size_t{3}});
  if (!positions.empty())
    std::memcpy(joints.mutable_data(), positions.data()->data(), positions.size() * sizeof positions[0]);
  return joints;
}

py::array_t<float> skin_of(const Asset& asset) {
  const std::vector<float> dense = to_dense(asset.skin, asset.skeleton.size());
  py::array_t<float> skin({asset.skin.rows(), asset.skeleton.size()});
  if (!dense.empty()) std::memcpy(skin.mutable_data(), dense.data(), dense.size() * sizeof dense[0]);
  return skin;
}

py::array_t<std::uint8_t> array_of(const engine::Picture& picture) {
  py::array_t<std::uint8_t> array(
      {static_cast<std::size_t>(picture.height), static_cast<std::size_t>(picture.width), std::size_t{4}});
  if (!picture.rgba.empty()) std::memcpy(array.mutable_data(), picture.rgba.data(), picture.rgba.size());
  return array;
}

engine::Generator make_generator(const std::optional<std::filesystem::path>& runs,
                                 const std::optional<std::filesystem::path>& structure_flow,
                                 const std::optional<std::filesystem::path>& latent_flow, bool counts_joints,
                                 const std::string& device, const std::string& precision,
                                 const std::string& background) {
  engine::GeneratorOptions options;
  if (runs) options.runs = *runs;
  if (structure_flow) options.structure_flow = *structure_flow;
  if (latent_flow) options.latent_flow = *latent_flow;
  options.counts_joints = counts_joints;
  options.device = device;
  options.precision = precision;
  options.background = background;
  return unlocked([&] { return engine::Generator(options); });
}

py::dict scores_of(const engine::Scores& scores) {
  py::dict result;
  for (const auto& [key, value] : scores.values) result[py::str(key)] = value;
  return result;
}

void add_errors(py::module_& m) {
  static py::exception<Error> error(m, "Error", PyExc_RuntimeError);
  static py::exception<InputError> input(m, "InputError", PyExc_ValueError);
  static py::exception<Interrupted> interrupted(m, "Interrupted", PyExc_RuntimeError);
  // NOLINTNEXTLINE(performance-unnecessary-value-param): a translator has this type.
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Interrupted& e) {
      PyErr_SetString(interrupted.ptr(), e.what());
    } catch (const InputError& e) {
      PyErr_SetString(input.ptr(), e.what());
    } catch (const Error& e) {
      PyErr_SetString(error.ptr(), e.what());
    }
  });
}

void add_asset(py::module_& m) {
  py::class_<Asset, AssetPtr>(m, "Asset", "A rigged asset in memory. Z up; arrays are views unless said otherwise.")
      .def_readwrite("name", &Asset::name)
      .def_property_readonly(
          "vertices", [](const py::object& self) { return view_of<float>(self.cast<Asset&>().mesh.vertices, 3, self); },
          "float32 [V, 3], a view")
      .def_property_readonly(
          "faces",
          [](const py::object& self) { return view_of<std::int32_t>(self.cast<Asset&>().mesh.faces, 3, self); },
          "int32 [F, 3], a view")
      .def_property_readonly("joints", &joints_of, "float64 [J, 3], bind pose, a copy")
      .def_property_readonly(
          "parents",
          [](const py::object& self) {
            const std::vector<int>& parents = self.cast<Asset&>().skeleton.parents;
            return py::array_t<int>(static_cast<py::ssize_t>(parents.size()), parents.data(), self);
          },
          "int32 [J], -1 for the root, a view")
      .def_property_readonly("joint_names", [](const Asset& asset) { return asset.skeleton.names; })
      .def_property_readonly("skin", &skin_of, "float32 [V, J], rows sum to 1, a copy")
      .def_property_readonly(
          "clips",
          [](const Asset& asset) {
            std::vector<std::pair<std::string, double>> clips;
            for (const Animation& clip : asset.animations) clips.emplace_back(clip.name, clip.duration());
            return clips;
          },
          "list of (name, seconds)")
      .def("__repr__", [](const Asset& asset) {
        return "<anigen.Asset '" + asset.name + "': " + std::to_string(asset.mesh.vertices.size()) + " vertices, " +
               std::to_string(asset.mesh.faces.size()) + " faces, " + std::to_string(asset.skeleton.size()) +
               " joints, " + std::to_string(asset.animations.size()) + " clips>";
      });
}

void add_files(py::module_& m) {
  m.def(
      "load",
      [](const std::filesystem::path& file) {
        return unlocked([&] { return std::make_shared<Asset>(engine::load(file)); });
      },
      py::arg("file"));
  m.def(
      "load_bytes",
      [](const py::bytes& data, const std::string& name) {
        const std::string bytes = data;
        return unlocked([&] { return std::make_shared<Asset>(engine::load_bytes(bytes, name)); });
      },
      py::arg("data"), py::arg("name"));
  m.def(
      "save",
      [](const AssetPtr& asset, const std::filesystem::path& file) { unlocked([&] { engine::save(*asset, file); }); },
      py::arg("asset").none(false), py::arg("file"));
  m.def(
      "save_bytes",
      [](const AssetPtr& asset, const std::string& format) {
        return py::bytes(unlocked([&] { return engine::save_bytes(*asset, format); }));
      },
      py::arg("asset").none(false), py::arg("format") = "glb");
  m.def("from_arrays", &from_arrays, py::arg("vertices"), py::arg("faces"), py::arg("joints") = py::none(),
        py::arg("parents") = std::vector<int>(), py::arg("skin") = py::none(),
        py::arg("names") = std::vector<std::string>());
}

void add_rigging(py::module_& m) {
  const engine::RigOptions usual;
  const engine::AnimateOptions usual_clips;
  m.def(
      "rig",
      [](const AssetPtr& asset, const std::string& method, const std::string& skin,
         const std::vector<std::string>& templates, bool keep_skeleton, bool learned_joints, std::size_t joints,
         bool symmetric, std::size_t influences, const std::string& names, double height, bool ground,
         const ProgressFunction& progress) {
        engine::RigOptions options;
        options.method = method;
        options.skin = skin;
        options.templates = templates;
        options.keep_skeleton = keep_skeleton;
        options.learned_joints = learned_joints;
        options.joints = joints;
        options.symmetric = symmetric;
        options.influences = influences;
        options.names = names;
        options.height = height;
        options.ground = ground;
        WatchedCall call(progress);
        engine::Rigged rigged = call.run([&](Job* job) { return engine::rig(*asset, options, job); });
        return std::make_pair(std::make_shared<Asset>(std::move(rigged.asset)), rigged.note);
      },
      py::arg("asset").none(false), py::kw_only(), py::arg("method") = usual.method, py::arg("skin") = usual.skin,
      py::arg("templates") = usual.templates, py::arg("keep_skeleton") = usual.keep_skeleton,
      py::arg("learned_joints") = usual.learned_joints, py::arg("joints") = usual.joints,
      py::arg("symmetric") = usual.symmetric, py::arg("influences") = usual.influences, py::arg("names") = usual.names,
      py::arg("height") = usual.height, py::arg("ground") = usual.ground, py::arg("progress") = py::none());
  m.def("template_words", &engine::template_words);
  m.def(
      "animate",
      [](const AssetPtr& asset, const std::vector<std::string>& motions, double fps, double speed, bool travel,
         const ProgressFunction& progress) {
        engine::AnimateOptions options;
        options.motions = motions;
        options.fps = fps;
        options.speed = speed;
        options.travel = travel;
        WatchedCall call(progress);
        std::vector<Animation> clips = call.run([&](Job* job) { return engine::animate(*asset, options, job); });
        auto animated = std::make_shared<Asset>(*asset);
        animated->animations.insert(animated->animations.end(), clips.begin(), clips.end());
        return animated;
      },
      py::arg("asset").none(false), py::arg("motions") = usual_clips.motions, py::kw_only(),
      py::arg("fps") = usual_clips.fps, py::arg("speed") = usual_clips.speed, py::arg("travel") = usual_clips.travel,
      py::arg("progress") = py::none());
  m.def("motion_words", &engine::motion_words);
  m.def(
      "motions_of", [](const AssetPtr& asset) { return engine::motions_of(*asset); }, py::arg("asset").none(false));
}

void add_measures(py::module_& m) {
  const engine::EvaluateOptions usual;
  m.def(
      "evaluate",
      [](const AssetPtr& predicted, const AssetPtr& truth, const std::vector<std::string>& metrics,
         const std::string& protocol, const std::string& normalization, bool registration, std::size_t samples,
         const ProgressFunction& progress) {
        engine::EvaluateOptions options;
        options.groups = metrics;
        options.protocol = protocol;
        options.normalization = normalization;
        options.registration = registration;
        options.surface_samples = samples;
        WatchedCall call(progress);
        return scores_of(call.run([&](Job* job) { return engine::evaluate(*predicted, *truth, options, job); }));
      },
      py::arg("predicted").none(false), py::arg("truth").none(false), py::kw_only(), py::arg("metrics") = usual.groups,
      py::arg("protocol") = usual.protocol, py::arg("normalization") = usual.normalization,
      py::arg("registration") = usual.registration, py::arg("surface_samples") = usual.surface_samples,
      py::arg("progress") = py::none());
  const auto add_distance = [&m](const char* name, double (*distance)(const JointTree&, const JointTree&)) {
    m.def(
        name,
        [distance](const py::object& joints_a, const py::object& parents_a, const py::object& joints_b,
                   const py::object& parents_b) {
          const JointTree a = tree_in(joints_a, parents_a, "_a"), b = tree_in(joints_b, parents_b, "_b");
          return unlocked([&] { return distance(a, b); });
        },
        py::arg("joints_a"), py::arg("parents_a"), py::arg("joints_b"), py::arg("parents_b"));
  };
  add_distance("gromov_wasserstein", &engine::gromov_wasserstein);
  add_distance("wasserstein", &engine::wasserstein);
  m.def(
      "chamfer",
      [](const py::object& joints_a, const py::object& parents_a, const py::object& joints_b,
         const py::object& parents_b) {
        const engine::Chamfer found =
            engine::chamfer(tree_in(joints_a, parents_a, "_a"), tree_in(joints_b, parents_b, "_b"));
        py::dict result;
        result["j2j"] = found.j2j;
        result["j2b"] = found.j2b;
        result["b2b"] = found.b2b;
        return result;
      },
      py::arg("joints_a"), py::arg("parents_a"), py::arg("joints_b"), py::arg("parents_b"));
  m.def(
      "lint",
      [](const std::variant<AssetPtr, std::filesystem::path>& of) {
        const auto* file = std::get_if<std::filesystem::path>(&of);
        py::list findings;
        for (const engine::Finding& found : unlocked(
                 [&] { return file != nullptr ? engine::lint_file(*file) : engine::lint(*std::get<AssetPtr>(of)); })) {
          py::dict one;
          one["code"] = found.code;
          one["severity"] = found.severity;
          one["sentence"] = found.sentence;
          one["count"] = found.count;
          one["share"] = found.share;
          findings.append(one);
        }
        return findings;
      },
      py::arg("asset").none(false));
  m.def(
      "render",
      [](const AssetPtr& asset, int width, int height, const std::string& mode, bool skeleton, bool transparent,
         double yaw, double pitch, int clip, double time) {
        engine::RenderOptions options;
        options.width = width;
        options.height = height;
        options.mode = mode;
        options.skeleton = skeleton;
        options.transparent = transparent;
        options.yaw = yaw;
        options.pitch = pitch;
        options.clip = clip;
        options.time = time;
        return array_of(unlocked([&] { return engine::render(*asset, options); }));
      },
      py::arg("asset").none(false), py::kw_only(), py::arg("width") = 512, py::arg("height") = 512,
      py::arg("mode") = "color", py::arg("skeleton") = false, py::arg("transparent") = false,
      py::arg("yaw") = engine::RenderOptions().yaw, py::arg("pitch") = engine::RenderOptions().pitch,
      py::arg("clip") = -1, py::arg("time") = 0.0);
}

py::array_t<std::int32_t> array_of(const std::vector<engine::VoxelIndex>& voxels) {
  static_assert(sizeof(engine::VoxelIndex) == 3 * sizeof(std::int32_t), "voxels are packed");
  py::array_t<std::int32_t> array({voxels.size(), std::size_t{3}});
  if (!voxels.empty()) std::memcpy(array.mutable_data(), voxels.data(), voxels.size() * sizeof voxels[0]);
  return array;
}

py::dict prepare_asset(const AssetPtr& asset, const std::string& cleaning, int resolution,
                       const ProgressFunction& progress) {
  engine::PrepareOptions options;
  options.cleaning = cleaning;
  options.resolution = resolution;
  WatchedCall call(progress);
  engine::PreparedAsset prepared = call.run([&](Job* job) { return engine::prepare(*asset, options, job); });
  py::dict result;
  result["scale"] = prepared.scale;
  result["offset"] = py::array_t<double>(3, prepared.offset.data());
  result["voxels"] = array_of(prepared.voxels);
  result["skeleton_voxels"] = array_of(prepared.skeleton_voxels);
  result["findings"] = prepared.findings;
  result["usable"] = prepared.usable;
  result["asset"] = std::make_shared<Asset>(std::move(prepared.asset));
  return result;
}

using Paths = std::vector<std::filesystem::path>;

py::dict prepare_dataset(const std::variant<std::filesystem::path, Paths>& inputs, const std::filesystem::path& output,
                         const engine::PrepareOptions& options, const ProgressFunction& progress) {
  WatchedCall call(progress);
  const Paths all = inputs.index() == 0 ? Paths{std::get<0>(inputs)} : std::get<1>(inputs);
  const engine::PreparedDataset made = call.run([&](Job* job) { return engine::prepare(all, output, options, job); });
  py::dict result;
  result["assets"] = made.assets;
  result["variants"] = made.variants;
  result["reused"] = made.reused;
  result["train"] = made.train;
  result["test"] = made.test;
  result["unusable"] = made.unusable;
  result["failed_steps"] = made.failed_steps;
  result["bytes"] = made.bytes;
  py::list rejected;
  for (const engine::RejectedSource& one : made.rejected) {
    py::dict row;
    row["source"] = one.source;
    row["reason"] = one.reason;
    row["step"] = one.step;
    rejected.append(row);
  }
  result["rejected"] = rejected;
  return result;
}

void add_preparation(py::module_& m) {
  const engine::PrepareOptions usual;
  m.def("prepare", &prepare_asset, py::arg("asset").none(false), py::kw_only(), py::arg("cleaning") = usual.cleaning,
        py::arg("resolution") = usual.resolution, py::arg("progress") = py::none());
  m.def(
      "prepare",
      [](const std::variant<std::filesystem::path, Paths>& inputs, const std::filesystem::path& output,
         std::size_t creatures, std::size_t poses, const std::string& cleaning, bool keep_assets, int resolution,
         std::size_t views, int view_size, std::size_t condition_views, int condition_view_size, bool front_cameras,
         bool view_geometry, const std::string& features, const std::optional<std::filesystem::path>& feature_weights,
         std::optional<double> test_fraction, std::uint64_t seed, const ProgressFunction& progress) {
        engine::PrepareOptions options;
        options.creatures = creatures;
        options.poses = poses;
        options.cleaning = cleaning;
        options.keep_assets = keep_assets;
        options.resolution = resolution;
        options.views = views;
        options.view_size = view_size;
        options.condition_views = condition_views;
        options.condition_view_size = condition_view_size;
        options.front_cameras = front_cameras;
        options.view_geometry = view_geometry;
        options.features = features;
        if (feature_weights) options.feature_weights = *feature_weights;
        options.test_fraction = test_fraction;
        options.seed = seed;
        return prepare_dataset(inputs, output, options, progress);
      },
      py::arg("inputs"), py::arg("output"), py::kw_only(), py::arg("creatures") = usual.creatures,
      py::arg("poses") = usual.poses, py::arg("cleaning") = usual.cleaning, py::arg("keep_assets") = usual.keep_assets,
      py::arg("resolution") = usual.resolution, py::arg("views") = usual.views, py::arg("view_size") = usual.view_size,
      py::arg("condition_views") = usual.condition_views, py::arg("condition_view_size") = usual.condition_view_size,
      py::arg("front_cameras") = usual.front_cameras, py::arg("view_geometry") = usual.view_geometry,
      py::arg("features") = usual.features, py::arg("feature_weights") = py::none(),
      py::arg("test_fraction") = py::none(), py::arg("seed") = usual.seed, py::arg("progress") = py::none());
}

/// Hands pictures to a Python function as (name, PNG as bytes); what it raises ends the call.
std::function<void(const std::string&, const std::string&)> pictures_for(const py::object& function) {
  if (function.is_none()) return nullptr;
  const auto shown = std::make_shared<py::object>(function);
  return [shown](const std::string& name, const std::string& png) {
    const py::gil_scoped_acquire lock;
    (*shown)(name, py::bytes(png));
  };
}

/// Bytes as they are, the contents of a file else.
std::string contents_of(const py::object& source) {
  if (source.is_none()) return "";
  if (py::isinstance<py::bytes>(source)) return source.cast<std::string>();
  return py::module_::import("pathlib").attr("Path")(source).attr("read_bytes")().cast<std::string>();
}

std::shared_ptr<engine::Generated> generate(engine::Generator& generator, const py::object& image, std::uint64_t seed,
                                            int joints, std::optional<int> ss_steps, std::optional<int> slat_steps,
                                            const py::object& mask, const std::string& stop_at,
                                            const py::object& voxels, const py::object& pictures,
                                            const ProgressFunction& progress) {
  engine::GenerateOptions options;
  options.seed = seed;
  options.joints = joints;
  options.structure_steps = ss_steps;
  options.latent_steps = slat_steps;
  options.mask = contents_of(mask);
  options.stop_at = stop_at;
  options.voxels = contents_of(voxels);
  options.pictures = pictures_for(pictures);
  WatchedCall call(progress);
  const bool in_memory = py::isinstance<py::bytes>(image);
  const std::string bytes = in_memory ? image.cast<std::string>() : "";
  const auto file = in_memory ? std::filesystem::path() : image.cast<std::filesystem::path>();
  return std::make_shared<engine::Generated>(call.run([&](Job* job) {
    return in_memory ? generator.generate_bytes(bytes, options, job) : generator.generate(file, options, job);
  }));
}

void add_generator(py::module_& m) {
  const engine::GeneratorOptions usual_models;
  const engine::GenerateOptions usual;
  using Made = std::shared_ptr<engine::Generated>;
  py::class_<engine::Generated, Made>(m, "Generated")
      .def_property_readonly("asset",
                             [](const Made& made) {  // it keeps what it is a part of
                               const bool stopped = made->asset.mesh.vertices.empty();
                               return stopped ? nullptr : AssetPtr(made, &made->asset);
                             })
      .def_readonly("notices", &engine::Generated::notices)
      .def_readonly("seconds", &engine::Generated::seconds)
      .def_property_readonly("voxels", [](const engine::Generated& made) { return py::bytes(made.voxels); });
  py::class_<engine::Generator>(m, "Generator")
      .def(py::init(&make_generator), py::kw_only(), py::arg("runs") = py::none(),
           py::arg("structure_flow") = py::none(), py::arg("latent_flow") = py::none(),
           py::arg("counts_joints") = usual_models.counts_joints, py::arg("device") = usual_models.device,
           py::arg("precision") = usual_models.precision, py::arg("background") = usual_models.background)
      .def("generate", &generate, py::arg("image"), py::kw_only(), py::arg("seed") = usual.seed,
           py::arg("joints") = usual.joints, py::arg("ss_steps") = py::none(), py::arg("slat_steps") = py::none(),
           py::arg("mask") = py::none(), py::arg("stop_at") = usual.stop_at, py::arg("voxels") = py::none(),
           py::arg("pictures") = py::none(), py::arg("progress") = py::none());
}

}  // namespace

PYBIND11_MODULE(_anigen, m) {
  add_errors(m);
  add_asset(m);
  add_files(m);
  add_rigging(m);
  add_measures(m);
  add_preparation(m);
  add_generator(m);
}
