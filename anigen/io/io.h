#pragma once
/// Reading and writing files: glTF, OBJ, PLY, STL, images, array archives, rigs of every supported format. gltf/
/// turns Y-up into the world frame and back; fbx/ and usd/ write rigged assets; rigs/ reads whatever holds a rig as one
/// RiggedShape; arrays/ knows NPY, NPZ, pickle, PyTorch archives and safetensors.
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/image_resize.h"
#include "anigen/io/mtl.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/rig_reader.h"
#include "anigen/io/stl.h"
#include "anigen/io/write_rigged.h"
