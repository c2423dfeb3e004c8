#include "shim.h"

#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <fstream>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

struct VdbFile {
  std::vector<openvdb::GridBase::Ptr> grids;
};

struct VdbGrid {
  explicit VdbGrid(openvdb::FloatGrid::Ptr read)
    : grid(std::move(read)), leaf(grid->tree().cbeginLeaf()), tile(grid->tree().cbeginValueOn())
  {
    // Not into the leaves.
    tile.setMaxDepth(decltype(tile)::LEAF_DEPTH - 1);
  }

  openvdb::FloatGrid::Ptr grid;
  openvdb::FloatGrid::TreeType::LeafCIter leaf;
  openvdb::FloatGrid::TreeType::ValueOnCIter tile;
};

namespace {

void copy(char* to, size_t size, const std::string& text)
{
  const size_t length = std::min(text.size(), size - 1);
  std::memcpy(to, text.data(), length);
  to[length] = '\0';
}

/// Calls a function; an exception becomes `failure`, and is described where somebody wants to know.
template<typename Result, typename Function> Result guard(Result failure, VdbError* error, Function function) noexcept
{
  const auto describe = [error](const std::string& text) {
    if (error) copy(error->text, sizeof error->text, text);
  };
  try {
    return function();
  } catch (const std::bad_alloc&) {
    describe("out of memory");
  } catch (const std::ios_base::failure&) {
    describe("the file ends too early, or cannot be read");
  } catch (const std::exception& exception) {
    describe(exception.what());
  } catch (...) {
    describe("unknown exception");
  }
  return failure;
}

void initialise()
{
  static const bool done = [] {
    openvdb::initialize();
    return true;
  }();
  (void)done;
}

VdbClass class_of(openvdb::GridClass grid_class)
{
  switch (grid_class) {
    case openvdb::GRID_FOG_VOLUME: return VDB_CLASS_FOG_VOLUME;
    case openvdb::GRID_LEVEL_SET: return VDB_CLASS_LEVEL_SET;
    case openvdb::GRID_STAGGERED: return VDB_CLASS_STAGGERED;
    case openvdb::GRID_UNKNOWN: break;
  }
  return VDB_CLASS_UNKNOWN;
}

}  // namespace

int32_t vdb_version(void)
{
  return openvdb::OPENVDB_LIBRARY_MAJOR_VERSION * 10000 + openvdb::OPENVDB_LIBRARY_MINOR_VERSION * 100 +
         openvdb::OPENVDB_LIBRARY_PATCH_VERSION;
}

VdbFile* vdb_open(const char* path, VdbError* error)
{
  return guard<VdbFile*>(nullptr, error, [&] {
    initialise();
    auto opened = std::make_unique<VdbFile>();
    // As a stream, which throws at the end of the file: OpenVDB's own files read on behind it, and a wrong count then takes hours.
    std::ifstream stream;
    stream.exceptions(std::ios_base::badbit | std::ios_base::failbit);
    stream.open(path, std::ios_base::in | std::ios_base::binary);
    // OpenVDB reads on in files that are newer than itself, and prints that.
    char head[12];
    stream.read(head, sizeof head);
    uint32_t version;
    std::memcpy(&version, head + 8, sizeof version);
    if (version > openvdb::OPENVDB_FILE_VERSION || version < openvdb::OPENVDB_FILE_VERSION_ROOTNODE_MAP)
      throw std::runtime_error("its version is " + std::to_string(version) + ", which this OpenVDB cannot read (up to " +
                               std::to_string(openvdb::OPENVDB_FILE_VERSION) + "): write it anew with another version");
    stream.seekg(0);
    openvdb::io::Stream read(stream, /*delayLoad=*/false);
    for (const auto& grid : *read.getGrids())
      if (grid) opened->grids.push_back(grid);
    return opened.release();
  });
}

void vdb_close(VdbFile* file)
{
  guard<bool>(false, nullptr, [&] {
    delete file;
    return true;
  });
}

int32_t vdb_grid_count(const VdbFile* file)
{
  return static_cast<int32_t>(file->grids.size());
}

bool vdb_grid_info(const VdbFile* file, int32_t number, VdbInfo* info)
{
  return guard(false, nullptr, [&] {
    if (number < 0 || static_cast<size_t>(number) >= file->grids.size()) return false;
    const auto& grid = file->grids[static_cast<size_t>(number)];
    copy(info->name, sizeof info->name, grid->getName());
    copy(info->value_type, sizeof info->value_type, grid->valueType());
    info->grid_class = class_of(grid->getGridClass());
    info->is_float = grid->isType<openvdb::FloatGrid>();
    info->is_linear = grid->transform().isLinear();
    std::fill(std::begin(info->to_world), std::end(info->to_world), 0.0);
    if (info->is_linear) {
      // Rows are the images of the axes: OpenVDB's vectors stand left of their matrices.
      const auto matrix = grid->transform().baseMap()->getAffineMap()->getMat4();
      for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 3; ++column) info->to_world[row * 3 + column] = matrix(row, column);
    }
    return true;
  });
}

VdbGrid* vdb_grid_open(VdbFile* file, int32_t number, VdbError* error)
{
  return guard<VdbGrid*>(nullptr, error, [&]() -> VdbGrid* {
    if (number < 0 || static_cast<size_t>(number) >= file->grids.size()) throw std::runtime_error("no such grid");
    auto read = openvdb::gridPtrCast<openvdb::FloatGrid>(file->grids[static_cast<size_t>(number)]);
    if (!read) throw std::runtime_error("the grid is not of floats");
    return std::make_unique<VdbGrid>(std::move(read)).release();
  });
}

void vdb_grid_free(VdbGrid* grid)
{
  guard<bool>(false, nullptr, [&] {
    delete grid;
    return true;
  });
}

float vdb_grid_background(const VdbGrid* grid)
{
  return grid->grid->background();
}

bool vdb_grid_next_leaf(VdbGrid* grid, int32_t* origin, float* values)
{
  return guard(false, nullptr, [&] {
    if (!grid->leaf) return false;
    const auto& leaf = *grid->leaf;
    const auto first = leaf.origin();
    for (int axis = 0; axis < 3; ++axis) origin[axis] = first[axis];
    static_assert(openvdb::FloatTree::LeafNodeType::SIZE == 512, "leaves of 8^3 voxels");
    for (openvdb::Index at = 0; at < 512; ++at) values[at] = leaf.getValue(at);
    ++grid->leaf;
    return true;
  });
}

bool vdb_grid_next_tile(VdbGrid* grid, int32_t* origin, int32_t* side, float* value)
{
  return guard(false, nullptr, [&] {
    if (!grid->tile) return false;
    openvdb::CoordBBox box;
    grid->tile.getBoundingBox(box);
    for (int axis = 0; axis < 3; ++axis) origin[axis] = box.min()[axis];
    *side = box.dim()[0];
    *value = *grid->tile;
    ++grid->tile;
    return true;
  });
}

bool vdb_write(const char* path, const VdbDense* dense, VdbError* error)
{
  return guard(false, error, [&] {
    initialise();
    auto grid = openvdb::FloatGrid::create(0.0f);
    const openvdb::Coord low(dense->origin[0], dense->origin[1], dense->origin[2]);
    const openvdb::Coord size(dense->size[0], dense->size[1], dense->size[2]);
    const openvdb::CoordBBox box(low, low + size.offsetBy(-1));
    const openvdb::tools::Dense<const float, openvdb::tools::LayoutZYX> values(box, dense->values);
    openvdb::tools::copyFromDense(values, *grid, 0.0f);
    openvdb::math::Mat4d matrix = openvdb::math::Mat4d::identity();
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 3; ++column) matrix(row, column) = dense->to_world[row * 3 + column];
    grid->setTransform(openvdb::math::Transform::createLinearTransform(matrix));
    grid->setName(dense->name);
    grid->setSaveFloatAsHalf(dense->is_half);
    switch (dense->grid_class) {
      case VDB_CLASS_FOG_VOLUME: grid->setGridClass(openvdb::GRID_FOG_VOLUME); break;
      case VDB_CLASS_LEVEL_SET: grid->setGridClass(openvdb::GRID_LEVEL_SET); break;
      case VDB_CLASS_STAGGERED: grid->setGridClass(openvdb::GRID_STAGGERED); break;
      case VDB_CLASS_UNKNOWN: break;
    }
    openvdb::io::File(path).write(openvdb::GridPtrVec{grid});
    return true;
  });
}
