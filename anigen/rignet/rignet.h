#pragma once
/// RigNet, a learned rigger: mesh graph networks, joint clustering, its data.
#include "anigen/rignet/dataset.h"
#include "anigen/rignet/graph.h"
#include "anigen/rignet/model.h"
#include "anigen/rignet/skeleton.h"
#include "anigen/rignet/surface_paths.h"
