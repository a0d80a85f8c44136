#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <type_traits>
#include <vector>

namespace anigen {

/// One option as every program has it: one name for one meaning.
struct OptionRow {
  const char* name;
  char letter;        ///< of the short form; 0: none
  const char* value;  ///< word for the value in --help, of which "a|b" are the only ones; "" for a flag
  const char* group;  ///< its heading in --help
  const char* help;   ///< holds in every program; add_option() may append what holds in one
  /// Names of version 0.1, which work for one version more, in no --help: "program:--name"; "+1": its value was 1 less.
  const char* old_names;
};

// clang-format off
/// Every option of every program. Programs take their options from here with add_option() alone.
inline constexpr OptionRow kOptions[] = {
    // --- Input ---
    {"files", 0, "PATH", "Input", "Files or folders", ""},
    {"FILE", 0, "FILE", "Input", "JSON file of the experiment", ""},
    {"MESH", 0, "PATH", "Input", "Mesh with or without a rig: .glb .gltf .fbx .dae .obj .ply .stl .3mf, a text or NPZ rig, or one sample of a shard (FILE#ID)", ""},
    {"--input", 0, "PATH", "Input", "Sources: .glb .gltf .fbx .dae, obj with rig text, Articulation-XL or rig .npz, Anymate .pt, published datasets, or folders of these", ""},
    {"--procedural", 0, "N", "Input", "Number of procedural creatures", ""},
    {"--stream", 0, "N", "Input", "Make shards of so many new creatures for as long as trainings read them; --shards are there at a time", ""},
    {"--dataset", 'd', "PATH", "Input", "Dataset", "merge:--out train:--data-dir encode:--data eval:--gt"},
    {"--split", 0, "FILE", "Input", "File of the ids to use; repeatable [all]", ""},
    {"--limit", 'n', "N", "Input", "Use only so many of the first assets; 0: all", "generate:--most rig:--most eval:--most"},
    {"--id", 0, "ID", "Input", "Asset of the dataset; repeatable", ""},
    {"--image", 'i', "PATH", "Input", "Image, or folder of images", ""},
    {"--one-object", 0, "", "Input", "All images show one object, from several sides: one asset, called as the first of them", ""},
    {"--mask", 0, "FILE", "Input", "Mask of the image, of its size: the object is where it is above half. In place of --background", ""},
    {"--voxels", 0, "FILE", "Input", "voxels.npz of an earlier call, in place of what stage 4 gives", ""},
    {"--image-views", 0, "N", "Input", "Instead of the first condition view of an asset, so many, spread over those there are, as views of one object", ""},
    {"--image-split", 0, "FILE", "Input", "Instead of --image: the first condition view of these assets of --image-dataset", "rig:--picture-split"},
    {"--image-dataset", 0, "PATH", "Input", "Dataset of the assets of --image-split [--dataset]", ""},
    {"--mesh", 'm', "PATH", "Input", "Mesh to rig, or folder or dataset of them: .glb .gltf .fbx .dae .obj .ply .stl .3mf, NPZ rigs", ""},
    {"--mesh-split", 0, "FILE", "Input", "File of the ids of --mesh to use; repeatable [all]", ""},
    {"--mesh-up", 0, "format|y-up|z-up", "Input", "Up axis of --mesh", "rig:--mesh-axes"},
    {"--pred", 'p', "[NAME=]PATH", "Input", "Predictions: a file, a folder, a shard, or a CSV of pairs; repeatable", ""},
    {"--pred-up", 0, "[NAME=]AXIS", "Input", "Up axis of --pred: format, y-up or z-up; with NAME= of those predictions alone; repeatable [format]", "eval:--pred-axes"},
    {"--dataset-up", 0, "format|y-up|z-up", "Input", "Up axis of --dataset", "eval:--gt-axes"},
    {"--asset", 0, "PATH", "Input", "Rigged asset to animate, or folder of them: .glb .gltf .fbx .dae", ""},
    {"--motion", 0, "FILE[#CLIP]", "Input", "Motion: a .bvh, or a clip of a .glb, .gltf, .fbx or .dae", ""},
    {"--video", 0, "PATH", "Input", "Video of the object to follow: a folder of frames by name, with cameras in its transforms.json or without, or a video file", ""},
    {"--config", 'c', "FILE", "Input", "JSON config [config.json of the output folder]", ""},
    {"--set", 0, "PATH.TO.KEY=VALUE", "Input", "Override a value of the config or experiment; repeatable", ""},
    // --- Output ---
    {"--output", 'o', "PATH", "Output", "File or folder to write", "prepare:--out rig:--out eval:--out experiment:--out inspect:--picture inspect:--export"},
    {"--asset-name", 0, "NAME", "Output", "Name of the asset, for one image [that of the image]", "generate:--name"},
    {"--latents-name", 0, "NAME", "Output", "Name of the latents [that of the run folder]", "encode:--name"},
    {"--axes", 0, "gltf|published", "Output", "Axes in the written files; published: (-x, z, y), turned by 180 degrees about the vertical", ""},
    {"--influences", 0, "N", "Output", "Joints per vertex in the written files", ""},
    {"--influence-loss", 0, "", "Output", "Measure what keeping only --influences joints per vertex changes", ""},
    {"--format", 0, "glb|gltf|fbx|usdz|usda", "Output", "Format of the files in a folder; a file's extension says its own [glb]", ""},
    {"--no-graft", 0, "", "Output", "Write a new file with base colour alone, where otherwise the rig is added to a copy of the .glb or .gltf", ""},
    {"--weights", 0, "", "Output", "Check that the checkpoints of a run hold what its config.json asks for", ""},
    {"--lint", 0, "", "Output", "Say whether rigs are good: weights, joints, names, axes, and the surface in poses. Exits with 1 for findings of --lint-level", ""},
    {"--lint-level", 0, "error|warning", "Output", "Least severity of --lint that fails", ""},
    {"--drop-clips", 0, "", "Output", "Leave out the clips that the file has; else new ones stand behind them", ""},
    {"--turntable", 0, "PATH", "Output", "Draw the first new clip: a .png is one sheet; else a folder for numbered frames", ""},
    {"--list", 0, "", "Output", "Only say which motions the asset can do, and which clips it has", ""},
    {"--preview", 0, "", "Output", "Also write <name>.png: the asset, its weights, its skeleton", "rig:--pictures"},
    {"--still", 0, "", "Output", "Write no idle clip into mesh.glb", ""},
    {"--obj", 0, "", "Output", "Also write mesh.obj and mesh.rig.json", ""},
    {"--intermediate", 0, "", "Output", "Also write the results of the stages: voxels.png, ss_latents.npz, latents.npz, votes.glb, dense.glb", ""},
    {"--votes", 0, "", "Output", "Also write <id>.votes.glb and .ply: the voxels' votes for joints, coloured by confidence", ""},
    {"--no-report", 0, "", "Output", "Do not write report.html", ""},
    {"--report-images", 0, "N", "Output", "Assets to draw in the report: worst (and, of weights, best) ones", "eval:--pictures"},
    {"--worst-by", 0, "METRIC", "Output", "Metric that orders the assets of the report", ""},
    {"--no-assets", 0, "", "Output", "Do not keep the assets themselves (assets/<id>.glb)", ""},
    {"--json", 0, "", "Output", "Print results as JSON on standard output", ""},
    // --- Models ---
    {"--run", 0, "DIR", "Models", "Run folder of the stage", ""},
    {"--runs", 0, "DIR", "Models", "Folder with the runs of both flows, such as the released ckpts/; of several variants ss_flow_solo and slat_flow_auto", "generate:--checkpoint"},
    {"--ss-flow", 0, "DIR", "Models", "Run folder of stage 4, the flow of sparse structures, trained here or published", ""},
    {"--slat-flow", 0, "DIR", "Models", "Run folder of stage 5, the flow of structured latents, trained here or published", ""},
    {"--ss-dae", 0, "DIR", "Models", "Run folder of stage 2 [the one its flow names]", ""},
    {"--slat-dae", 0, "DIR", "Models", "Run folder of stage 3 [the one its flow names]", ""},
    {"--view", 0, "K", "Input", "Condition view of every asset, counted round", ""},
    {"--skin-ae", 0, "PATH", "Models", "Run folder or checkpoint of a skin auto-encoder to reconstruct with", ""},
    {"--skins", 0, "DIR", "Models", "Folder of NPZ files with skin [V, J] for the ground truth's vertices, found by any name of the asset", ""},
    {"--ckpt", 0, "WORD", "Models", "Checkpoint of the run", ""},
    {"--use-ema", 0, "", "Models", "Use averaged weights [of runs trained here: yes; of published ones: no]", ""},
    {"--no-ema", 0, "", "Models", "Use the weights themselves", ""},
    {"--precision", 0, "fp32|bf16|int8", "Models", "Precision of the flows; bf16 takes half the memory, int8 for linear layers a quarter", ""},
    {"--low-memory", 0, "", "Models", "Keep one model in memory at a time; each is read again per image", ""},
    {"--joint-model", 0, "PATH", "Models", "For anymate and rignet: a run folder of anigen-train, or a .safetensors file of one; for anymate also a checkpoint as released [given joints]; for anigen: a folder with both flows [rig/ of the weights that are found]", ""},
    {"--connectivity-model", 0, "PATH", "Models", "For anymate and rignet, likewise [the shortest tree through predicted joints; given joints keep theirs]", ""},
    {"--skin-model", 0, "PATH", "Models", "For anymate and rignet, likewise [as --skin says, or geovoxel]", ""},
    {"--skin-run", 0, "DIR", "Models", "Run folder of AniGenSkinCorrectionTrainer", ""},
    // --- Images ---
    {"--background", 0, "WORD", "Images", "Removal of the background: auto, keep, alpha, grabcut", ""},
    {"--matting-network", 0, "PATH", "Images", "Network that separates object and background: a run folder of AniGenMattingTrainer, or an ONNX file [matting of the weights that are found, if they have it]", ""},
    {"--backgrounds", 0, "DIR", "Images", "Images that every second object is put before [drawn backgrounds alone]", ""},
    {"--matting-mean", 0, "R,G,B", "Images", "Taken from an ONNX network's red, green and blue in 0 … 1 [BiRefNet's]", ""},
    {"--matting-deviation", 0, "R,G,B", "Images", "Divides them then [BiRefNet's]", ""},
    {"--condition", 0, "WORD", "Images", "Images that are looked at: color or normal", ""},
    {"--normals", 0, "auto|color|file|estimator|flat", "Images", "Source of normals: color (the image stands in), file (--normal-map, or those of --dataset), estimator, flat; auto: file where there is one, else color", ""},
    {"--normal-map", 0, "FILE", "Images", "Normals of the one image", ""},
    {"--normal-weights", 0, "FILE", "Images", "For --normals estimator: dsine.pt (not ours; non-commercial research only)", ""},
    {"--retrieval-encoder", 0, "RUN", "Images", "Run of stage 4 whose image encoder describes the images that retrieval compares [their colours or normals]", ""},
    {"--retrieval-views", 0, "N", "Images", "Condition views of an asset that retrieval compares", "rig:--views"},
    // --- Sampling ---
    {"--ss-guidance", 0, "X", "Sampling", "Guidance scale g of stage 4: v0 + g (v - v0); 1: none [config: cfg_strength + 1]", "generate:--cfg-scale-ss+1 eval:--guidance+1"},
    {"--slat-guidance", 0, "X", "Sampling", "Guidance scale g of stage 5: v0 + g (v - v0); 1: none [config: cfg_strength + 1]", "generate:--cfg-scale+1"},
    {"--ss-steps", 0, "N", "Sampling", "Steps of the sampler in stage 4 [config]", "generate:--steps-ss eval:--steps"},
    {"--slat-steps", 0, "N", "Sampling", "Steps of the sampler in stage 5 [config]", "generate:--steps"},
    {"--stop-at", 0, "STAGE", "Sampling", "Go as far as that and write what is there", ""},
    {"--ss-interval", 0, "X X", "Sampling", "Guide stage 4 only at times between the two, 1: noise [config]", "generate:--cfg-interval-ss"},
    {"--slat-interval", 0, "X X", "Sampling", "Guide stage 5 only at times between the two, 1: noise [config]", "generate:--cfg-interval"},
    {"--solver", 0, "euler|midpoint|heun|adams", "Sampling", "Solver of both stages; midpoint and heun take two passes per step, adams keeps the velocity of the step before [config]", ""},
    {"--guidance-every", 0, "N", "Sampling", "Ask for the velocity without the image in every N-th guided step and keep its difference between [config, else 1]", ""},
    {"--windowed-steps", 0, "N", "Sampling", "Keep self attention inside windows in the first N steps [config, else 0]", ""},
    {"--velocity-tolerance", 0, "X", "Sampling", "Leave out passes of a step whose velocity those before predict to this relative error; 0: none [config, else 0]", ""},
    {"--view-rule", 0, "average|stochastic", "Sampling", "Share of several views of one object in a step: average, all, whose velocities are averaged; stochastic, one in turn", ""},
    {"--joints", 0, "N", "Sampling", "Wanted number of joints; 0: any", ""},
    {"--joint-density", 0, "X", "Sampling", "The wanted number as a share of 60 joints, 0 … 1", ""},
    {"--joint-level", 0, "N", "Sampling", "The wanted number by the published levels 0 … 4: none, 10, 15, 25, 35 joints", ""},
    // --- Mesh and skeleton ---
    {"--method", 0, "WORD", "Mesh and skeleton", "Method of rigging", ""},
    {"--skeleton", 0, "FILE", "Mesh and skeleton", "Rig with the joints to bind to, placed in the mesh [the mesh file's own]; for pinocchio the template", ""},
    {"--new-skeleton", 0, "", "Mesh and skeleton", "Find joints where the mesh has its own, too; for auto", ""},
    {"--template", 0, "WORD", "Mesh and skeleton", "Kind of body, for pinocchio and auto: biped, quadruped, horse, fox, bird, dragon, kaiju, fish, snake, spider; of several the one that fits best [biped and quadruped, as far as they fit]", "rig:--pinocchio-template"},
    {"--symmetric", 0, "", "Mesh and skeleton", "Joints of left and right mirror each other across the middle of the mesh; a branch of one side alone is copied to the other", ""},
    {"--add-joints", 0, "", "Mesh and skeleton", "Keep the mesh's own or the given skeleton, and add joints for parts where it has none, such as a tail, along the mesh's curve", ""},
    {"--one-body", 0, "", "Mesh and skeleton", "One skeleton even for bodies that stand apart, which auto and anigen rig one by one", ""},
    {"--curve-joints", 0, "N", "Mesh and skeleton", "For curve and auto: no more joints than these, along the curve", "rig:--most-joints"},
    {"--points", 0, "N", "Mesh and skeleton", "For anymate: points of the surface that the models look at [as in training; released: 8192]", ""},
    {"--joint-distance", 0, "X", "Mesh and skeleton", "For anymate: predicted joints this near are one, the mesh's longest side being 2 [as released: 0.03 regressed, 0.05 denoised; without meaning for volumes]", "rig:--eps"},
    {"--skin", 0, "nearest|geovoxel|heat|learned|none", "Mesh and skeleton", "Binding, other than the method's; learned: heat and geodesic voxels corrected by a network; none: the skeleton alone", ""},
    {"--geovoxel-resolution", 0, "N", "Mesh and skeleton", "For geovoxel: voxels along the mesh's longest side", "rig:--resolution"},
    {"--falloff", 0, "X", "Mesh and skeleton", "For geovoxel: from weights like 1/d² (0) to weights like 1/d⁴ (1)", ""},
    {"--cluster-algorithm", 0, "published|paper", "Mesh and skeleton", "Form of Algorithm 1 that groups votes to joints: the released code's, or the paper's [as the run's config says]", ""},
    {"--cluster-bandwidth", 0, "X", "Mesh and skeleton", "Cluster votes for joints within this distance, in units of the box [as fitted for the run, else 0.01]", "generate:--grouping-bandwidth encode:--grouping-bandwidth"},
    {"--cluster-min-votes", 0, "N", "Mesh and skeleton", "Clusters of fewer votes are no joint, unless none would be left [as fitted for the run, else 5]", "generate:--grouping-least-votes encode:--grouping-least-votes"},
    {"--true-skeleton", 0, "", "Mesh and skeleton", "Decode weights for the asset's own skeleton", ""},
    {"--solid", 0, "", "Mesh and skeleton", "Open borders, and parts that cross each other, are findings, too", ""},
    {"--no-crossings", 0, "", "Mesh and skeleton", "Do not look for faces that cross each other, which takes most of the time", ""},
    {"--merge-distance", 0, "X", "Mesh and skeleton", "Vertices within this share of the diagonal become one; 0: those at equal positions", ""},
    {"--fill-holes", 0, "N", "Mesh and skeleton", "Close holes with so many border edges or fewer; 0: none", ""},
    {"--alpha", 0, "X", "Mesh and skeleton", "Radius of the ball that rolls around the mesh, as a share of the diagonal: it passes no hole or gap that is narrower than it", ""},
    {"--offset", 0, "X", "Mesh and skeleton", "Distance of the wrap from the mesh, as a share of the diagonal [a thirtieth of --alpha]", ""},
    {"--edge-length", 0, "X", "Mesh and skeleton", "Wanted length of edges, as a share of the diagonal", ""},
    {"--faces", 0, "N", "Mesh and skeleton", "Wanted number of faces", ""},
    {"--sharp-angle", 0, "X", "Mesh and skeleton", "Edges whose faces turn by more degrees than this keep their place; 180: none", ""},
    {"--remesh-iterations", 0, "N", "Mesh and skeleton", "Rounds of splitting, collapsing, flipping and smoothing", ""},
    {"--reduction", 0, "X", "Mesh and skeleton", "Share of the faces to take away, 0: none", ""},
    {"--keep-hidden", 0, "", "Mesh and skeleton", "Keep faces inside the mesh, close no holes", ""},
    {"--hidden-views", 0, "N", "Mesh and skeleton", "Views from which faces may be seen (published: 1000)", ""},
    {"--no-filter-skin", 0, "", "Mesh and skeleton", "Keep weights of joints far away along the skeleton", ""},
    {"--no-smooth-skin", 0, "", "Mesh and skeleton", "Leave skin weights as they are decoded", ""},
    {"--smooth-iterations", 0, "N", "Mesh and skeleton", "Rounds of smoothing of skin weights", ""},
    {"--smooth-alpha", 0, "X", "Mesh and skeleton", "Share of the neighbours in a round of smoothing", ""},
    {"--rigid-parts", 0, "", "Mesh and skeleton", "Shells that mostly follow one joint follow it alone, so that hard parts do not bend", ""},
    {"--rigid-share", 0, "X", "Mesh and skeleton", "For --rigid-parts: least share of a shell's weight in one joint", ""},
    {"--texture-size", 0, "N", "Mesh and skeleton", "Texels along a side, 64 or more; 0: vertex colours", ""},
    {"--colors", 0, "picture|decoded", "Mesh and skeleton", "Colours of the surface: of the image on what it shows, where the weights know its camera, or decoded everywhere", ""},
    // --- Engine ---
    {"--bone-axes", 0, "world|along", "Engine", "Axes of the joints: those of the file's world, or y along the bone, rolls mirrored [own joints: theirs; new ones: world]", ""},
    {"--height", 0, "METRES", "Engine", "Height of the mesh in the file [as it is]", ""},
    {"--ground", 0, "", "Engine", "Stand the mesh on the ground, its root (hips) above the origin", ""},
    {"--root-bone", 0, "", "Engine", "Add a joint without weights at the origin, above all others", ""},
    {"--names", 0, "chain|vrm|mixamo|unreal|unity", "Engine", "Names of the joints: by chain and side, or, of a humanoid, of VRM, Mixamo, Unreal's mannequin, Unity [own joints: theirs; new ones: of the template, or by chain]", ""},
    {"--author", 0, "NAME", "Engine", "For a .vrm: author of the model; repeatable [unknown]", ""},
    {"--copyright", 0, "TEXT", "Engine", "For a .vrm: copyright of the model", ""},
    // --- Motion ---
    {"--pose", 0, "T", "Motion", "Add a clip of one frame: T, both arms straight aside", ""},
    {"--frames", 0, "N", "Motion", "Key frames of each clip [by --fps]", ""},
    {"--fps", 0, "X", "Motion", "Key frames per second", ""},
    {"--speed", 0, "X", "Motion", "Factor on the speed of motions", ""},
    {"--travel", 0, "", "Motion", "Built-in motions go forward; else they stay in place", ""},
    // --- Cleaning and splits ---
    {"--clean", 0, "none|anymate|articulation-xl", "Cleaning and splits", "Cleaning rules", ""},
    {"--clean-set", 0, "RULE=VALUE", "Cleaning and splits", "Change one rule, such as joints=[3,200] (datasets/README.md); repeatable", ""},
    {"--test-fraction", 0, "X", "Cleaning and splits", "Part of the usable real assets kept for testing [0.333, or what the sources say themselves]", ""},
    {"--test-count", 0, "N", "Cleaning and splits", "Number of usable real assets kept for testing", ""},
    {"--split-by", 0, "asset|skeleton", "Cleaning and splits", "Unit that the two count: skeleton keeps real assets of one joint tree on one side", ""},
    {"--procedural-test", 0, "N", "Cleaning and splits", "Number of usable creatures kept for testing", ""},
    {"--test-split", 0, "FILE", "Cleaning and splits", "Names of all test assets, one a line: uuid, sha256, path below the input, or SHARD#UUID", ""},
    {"--min-joints", 0, "N", "Cleaning and splits", "Fewer joints make is_bad_skeleton", ""},
    {"--max-joints", 0, "N", "Cleaning and splits", "More joints make is_bad_skeleton", ""},
    {"--same-bone", 0, "X", "Cleaning and splits", "Bones that differ by no more than this make is_bad_skeleton; 0 compares exactly", ""},
    {"--max-outside", 0, "X", "Cleaning and splits", "A larger part of joints outside the mesh makes is_bad_skeleton", ""},
    {"--max-invented-rows", 0, "X", "Cleaning and splits", "A larger part of vertices without weights in the file makes is_bad_skin", ""},
    {"--least-weight-sum", 0, "X", "Cleaning and splits", "A vertex with a lower sum makes is_bad_skin", ""},
    {"--near-skeletons", 0, "ignore|flag|drop", "Cleaning and splits", "Skeletons nearly equal to an earlier one [flag; with --clean anymate: drop]", ""},
    // --- Preparation ---
    {"--augment", 0, "N", "Preparation", "Posed variants of every asset", ""},
    {"--random-poses", 0, "", "Preparation", "Do not take poses from the assets' own animations", ""},
    {"--key-frames", 0, "", "Preparation", "Take poses at key frames of the assets' own animations alone: none in between, none of assets without", ""},
    {"--pose-probability", 0, "X", "Preparation", "Probability of each joint to be turned in a random pose", ""},
    {"--pose-angle", 0, "X", "Preparation", "Largest angle of a random pose, degrees", ""},
    {"--pose-scale", 0, "X", "Preparation", "Scale each axis of a variant by exp(u), u uniform between -X and X", ""},
    {"--voxel-resolution", 0, "N", "Preparation", "Cells along a side of the voxel grid", "prepare:--resolution"},
    {"--views", 0, "N", "Preparation", "Views for features (published: 150)", ""},
    {"--view-size", 0, "N", "Preparation", "Their side in pixels", ""},
    {"--cond-views", 0, "N", "Preparation", "Views for image conditions (published: 24)", ""},
    {"--cond-view-size", 0, "N", "Preparation", "Side of the condition views in pixels", ""},
    {"--cond-cameras", 0, "around|front", "Preparation", "Condition views from all sides, as published, or from where people take pictures", ""},
    {"--view-samples", 0, "N", "Preparation", "Anti-aliasing of all views: this many squared rays per pixel", ""},
    {"--view-geometry", 0, "", "Preparation", "Also write normals and depth of all views", ""},
    {"--features", 0, "MODEL", "Preparation", "Features of voxels: surface, or a DINOv2 model such as dinov2_vitl14_reg", ""},
    {"--feature-weights", 0, "FILE", "Preparation", "Weights of the DINOv2 model (.pth or .safetensors)", ""},
    {"--encode-ss", 0, "DIR", "Preparation", "Run folder of stage 2, by which anigen-encode ss adds latents to every shard of --stream", ""},
    {"--encode-slat", 0, "DIR", "Preparation", "Run folder of stage 3, by which anigen-encode slat adds latents to every shard of --stream", ""},
    // --- Metrics ---
    {"--protocol", 0, "anigen|magicarticulate|puppeteer|rignet|unirig|anymate|skintokens", "Metrics", "Evaluate as this work does: frame, registration, sampling, thresholds and units of its tables; writes protocol.md. skintokens is not supported: its evaluation is not published", ""},
    {"--normalize", 0, "centroid-rms|bounding-box|truth|truth-with-joints|none", "Metrics", "Normalisation before registration; truth: both sides by the truth's box", ""},
    {"--no-icp", 0, "", "Metrics", "Normalise only, do not register", ""},
    {"--visible-surface", 0, "", "Metrics", "Normalise, register and measure surfaces by their faces that can be seen from outside", ""},
    {"--merge-joints", 0, "X", "Metrics", "Joints within this distance of another are one joint, on both sides, in units of the box; 0: none", ""},
    {"--rotations", 0, "N", "Metrics", "Random rotations that registration starts from, beside the identity", ""},
    {"--icp-scale", 0, "", "Metrics", "Registration may change the scale", ""},
    {"--icp-plane", 0, "", "Metrics", "Point-to-plane registration", ""},
    {"--icp-trim", 0, "X", "Metrics", "Fraction of the closest correspondences to keep", ""},
    {"--exhaustive", 0, "", "Metrics", "Refine every start of registration, without pruning", ""},
    {"--metrics", 0, "NAME,...", "Metrics", "Only these: skeleton, transport, skin, motion, surface, image, anymate, soundness [all but the last]", ""},
    {"--transport", 0, "exact|sinkhorn", "Metrics", "Computation of W and GW: exact, or sinkhorn with its entropic regularisation", ""},
    {"--sinkhorn-epsilon", 0, "X", "Metrics", "Regularisation of --transport sinkhorn, as a share of the largest squared distance [0.001 for W, 0.005 for GW]", "eval:--epsilon"},
    {"--category-split", 0, "FILE", "Metrics", "Files of ids of the ground truth: is the one nearest to a prediction of its category (metric 'category')?", ""},
    {"--surface-samples", 0, "N", "Metrics", "Points per surface", ""},
    {"--image-size", 0, "N", "Metrics", "Pixels along a side of the views that the image metrics compare", ""},
    {"--image-encoder", 0, "DIR", "Metrics", "Run folder of a flow that was trained on images, such as ss_flow of the weights: computes encoder_distance, of what its image encoder sees in the views", ""},
    {"--lpips-weights", 0, "FILE [FILE]", "Metrics", "Files (.pth, .pt, .safetensors) with torchvision's vgg16 and with the linear heads of LPIPS v0.1, or one with both; without, LPIPS is not computed", ""},
    {"--poses", 0, "N", "Metrics", "Poses of the deformation error", ""},
    {"--motion-frames", 0, "N", "Metrics", "Frames of a motion that are compared", ""},
    {"--motion-images", 0, "N", "Metrics", "Assets to draw in motion, ground truth beside every prediction: in the report, and as frames and GLB in <output>/motion", "eval:--motion-pictures"},
    {"--train-split", 0, "FILE", "Metrics", "Ids that retrieval chooses from [as the flow's config says]", ""},
    {"--oracle", 0, "", "Metrics", "Say where the error of generated assets enters: each is made by the auto-encoder, on true voxels, with true latents, and as a whole", ""},
    {"--check", 0, "", "Metrics", "Also decode every latent and compare it with the voxels", ""},
    // --- Training ---
    {"--load", 0, "DIR", "Training", "Start from a checkpoint of this other run folder; ignored once the output folder has its own", ""},
    {"--warm-start", 0, "DIR", "Training", "Folder of pretrained weights (<class name>.safetensors or .pt) for the branches that published runs take from TRELLIS; none: train those too [config's trainer.args.pretrained_dir]", ""},
    {"--restart", 0, "", "Training", "Begin again as --load and --ckpt say although the output folder has checkpoints: later steps move to ckpts/abandoned-STEP-N there. The same command goes on with what it began until that run has ended", ""},
    {"--extend-to", 0, "STEP", "Training", "Make the run of the output folder longer: new number of steps in all. It goes on from before the learning rate fell; later steps move aside as by --restart", ""},
    {"--profile", 0, "N", "Training", "Measure where the time of so many steps goes, after two that warm up, into profile.md of the run, and stop", ""},
    {"--export", 0, "DIR", "Training", "Write the averaged weights of --output in half precision, with a config that knows no folders of this machine, to a folder of its name in DIR, and stop", ""},
    {"--export-precision", 0, "half|int8", "Training", "Of the weights that --export writes: 16 bits, or 8 with a scale per row of a matrix", ""},
    {"--tune", 0, "", "Training", "Time replicas, micro-batches and precisions for 20 steps each, write the fastest to the output's config.json and stop", ""},
    {"--schema", 0, "", "Training", "Print the JSON schema of configs with the models, dataset and trainer of --config and stop", ""},
    {"--print-config", 0, "", "Training", "Print the config in full, with --set, --dataset and every default, and stop", ""},
    {"--ranks", 0, "N", "Training", "Train by so many processes of this machine", ""},
    {"--rank-restarts", 0, "N", "Training", "With --ranks: start all again from the last checkpoint, so often, after one has failed", "train:--restarts"},
    {"--rank-timeout", 0, "SECONDS", "Training", "Time without a sign of life after which a rank is lost", "train:--timeout"},
    {"--rendezvous", 0, "URL", "Training", "Address by which ranks find each other, tcp://HOST:PORT of rank 0 or file:///PATH [the launcher's environment]", ""},
    {"--communication", 0, "fp32|bf16", "Training", "Precision of gradients on their way between ranks", ""},
    // --- Work ---
    {"--only", 0, "STEP", "Work", "Do only this part of the work", "prepare:--steps"},
    {"--force", 'f', "", "Work", "Do again what is up to date", "generate:--again encode:--again eval:--no-resume"},
    {"--retry-failed", 0, "", "Work", "Try again what failed before; what succeeded is kept", ""},
    {"--accept-other-code", 0, "", "Work", "Keep results of another build of the program when all else is the same", ""},
    {"--keep-going", 'k', "", "Work", "Exit with 0 when some of the inputs failed, but not all; the others are finished either way", "generate:--allow-failures encode:--allow-failures"},
    {"--strict", 0, "", "Work", "Exit with 1 when a source was rejected, too", ""},
    {"--dry-run", 0, "", "Work", "Only show what would be done", ""},
    {"--together", 0, "", "Work", "With --only: others may run the same job at the same time and share its work", ""},
    {"--emit", 0, "slurm", "Work", "Write array jobs for a cluster instead of running", ""},
    {"--scale", 0, "WORD", "Work", "One of the sizes that the file offers under \"scales\" [as the file has it]", ""},
    {"--programs", 0, "DIR", "Work", "Folder of the executables [that of this one]", ""},
    {"--shard", 0, "I/N", "Work", "Only part I of N, counted from 0; not needed for several to work at once", ""},
    {"--shards", 0, "N", "Work", "Shards that trainings read of --stream; at most two more are on the disk", ""},
    {"--stop-after", 0, "N", "Work", "Stop --stream after so many shards, with those of earlier calls; 0: when interrupted", ""},
    {"--workers", 0, "N", "Work", "Processes that work at once and share --threads", "experiment:--jobs"},
    {"--asset-timeout", 0, "SECONDS", "Work", "Time for one asset, after which it counts as failed; 0: no limit", "prepare:--timeout"},
    {"--memory-mb", 0, "N", "Work", "Memory of one worker, above which its asset counts as failed; 0: no limit", ""},
    {"--port", 0, "N", "Work", "Port of the server", ""},
    {"--job-memory", 0, "GB", "Work", "Memory of one job of the server, which is ended when it needs more", ""},
    {"--job-minutes", 0, "N", "Work", "Time of one job of the server, which is ended when it takes longer", ""},
    {"--first-job", 0, "DIR", "Work", "Only make the job that a first start shows, of an example image, and write its folder; installing does so", ""},
    {"--host", 0, "ADDRESS", "Work", "Address to listen at; one that others reach asks them for the token in the printed address", ""},
    {"--seed", 0, "N", "Work", "Seed of every random draw", ""},
    {"--threads", 'j', "N", "Work", "Threads to use; 0: all cores", "eval:--workers"},
    {"--device", 0, "cpu|cuda|cuda:N", "Work", "Device that networks compute on", ""},
    // --- Messages and help ---
    {"--quiet", 'q', "", "Messages and help", "No progress bars, warnings only; results are printed all the same", ""},
    {"--verbose", 'v', "", "Messages and help", "Debugging messages too", ""},
    {"--log-level", 0, "debug|info|warn|error|off", "Messages and help", "Least level of messages", ""},
    {"--check-options", 0, "", "Messages and help", "Only check the options and, for anigen-train, the config, and stop; other files need not be there yet", ""},
    {"--completion", 0, "bash|zsh|fish|json", "Messages and help", "Print the completion of this shell, or all options as JSON, and stop", ""},
    {"--man", 0, "", "Messages and help", "Print the manual page (| man -l -) and stop", ""},
    {"--version", 'V', "", "Messages and help", "Print version, commit and libraries and stop", ""},
    {"--help", 'h', "", "Messages and help", "Print this help and stop", ""},
};
// clang-format on

/// Row of an option. @throws std::logic_error when the table has none of this name
const OptionRow& option_row(const std::string& name);

/// "-o,--output", as CLI11 takes names.
std::string spelled(const OptionRow& row);

/// Words of a value that may be nothing else: {"fp32", "bf16"} of "fp32|bf16"; none for other value words and devices.
std::vector<std::string> choices_of(const OptionRow& row);

/// Gives an option the value word, group and choices of its row.
CLI::Option* described_option(CLI::Option* option, const OptionRow& row);

/// Adds an option of the table: a flag for a bool. Numbers and texts that are set show their default.
/// @param note appended to the row's help where a program has something to add
template <typename T>
CLI::Option* add_option(CLI::App& app, const std::string& name, T& variable, const std::string& note = "") {
  const OptionRow& row = option_row(name);
  const std::string help = row.help + note;
  if constexpr (std::is_same_v<T, bool>) {
    return described_option(app.add_flag(spelled(row), variable, help), row);
  } else {
    CLI::Option* option = described_option(app.add_option(spelled(row), variable, help), row);
    bool shown = std::is_arithmetic_v<T>;
    if constexpr (std::is_same_v<T, std::string>) shown = !variable.empty();
    return shown ? option->capture_default_str() : option;
  }
}

/// Adds a flag of the table that turns off what is on without it.
CLI::Option* add_switch_off(CLI::App& app, const std::string& name, bool& on, const std::string& note = "");

/// A command line in which names of version 0.1 are replaced by today's.
struct CurrentWords {
  std::vector<std::string> words;    ///< without the program
  std::vector<std::string> notices;  ///< one sentence for each name that was replaced
};

/// @param program "anigen-eval" @param words without the program
CurrentWords current_words(const std::string& program, const std::vector<std::string>& words);

}  // namespace anigen
