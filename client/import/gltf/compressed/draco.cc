#include "client/import/gltf/compressed/draco.h"

#include <exception>
#include <memory>

#include "draco/compression/decode.h"
#include "draco/compression/point_cloud/point_cloud_decoder.h"
#include "draco/core/varint_decoding.h"
#include "draco/metadata/metadata.h"

struct draco_mesh {
    std::unique_ptr<draco::Mesh> mesh;
};

namespace {

const uint16_t VERSION = 2 << 8 | 2; // what glTF's extension asks for

const char *check_head(draco::DecoderBuffer &in, size_t points, size_t triangles)
{
    draco::DracoHeader head;
    uint32_t points_said = 0, triangles_said = 0;
    uint8_t traversal = 0;

    if (!draco::PointCloudDecoder::DecodeHeader(&in, &head).ok())
        return "its Draco stream has no head";
    in.set_bitstream_version(uint16_t(head.version_major << 8 | head.version_minor));
    if (head.version_major != VERSION >> 8 || head.version_minor != (VERSION & 255))
        return "its Draco stream is not of version 2.2";
    if (head.encoder_type != draco::TRIANGULAR_MESH)
        return "its Draco stream is no mesh of triangles";
    if (head.flags & METADATA_FLAG_MASK)
        return "its Draco stream has metadata, which is not read";
    if (head.encoder_method == draco::MESH_EDGEBREAKER_ENCODING) {
        if (!in.Decode(&traversal) || !draco::DecodeVarint(&points_said, &in) || !draco::DecodeVarint(&triangles_said, &in))
            return "its Draco stream is cut short";
    } else if (!draco::DecodeVarint(&triangles_said, &in) || !draco::DecodeVarint(&points_said, &in)) {
        return "its Draco stream is cut short";
    }
    // Where edges are seams, a stream has fewer vertices than points.
    if (triangles_said != triangles || points_said > points)
        return "its Draco stream has other triangles or points than its accessors count";
    return nullptr;
}

template <typename T>
bool read_all(const draco::PointCloud &cloud, const draco::PointAttribute &from, int components, T *out)
{
    for (uint32_t i = 0; i < cloud.num_points(); i++, out += components) {
        draco::AttributeValueIndex at = from.mapped_index(draco::PointIndex(i));
        if (at.value() >= from.size() || !from.ConvertValue<T>(at, int8_t(components), out))
            return false;
    }
    return true;
}

} // namespace

extern "C" const char *draco_mesh_open(const uint8_t *stream, size_t size_bytes, size_t points, size_t triangles,
                                       struct draco_mesh **out)
{
    *out = nullptr;
    try {
        draco::DecoderBuffer in;
        draco::Decoder decoder;
        in.Init(reinterpret_cast<const char *>(stream), size_bytes);
        if (const char *wrong = check_head(in, points, triangles))
            return wrong;
        in.Init(reinterpret_cast<const char *>(stream), size_bytes);
        auto decoded = decoder.DecodeMeshFromBuffer(&in);
        if (!decoded.ok())
            return "its Draco stream is damaged";
        auto mesh = std::make_unique<draco_mesh>();
        mesh->mesh = std::move(decoded).value();
        if (mesh->mesh->num_faces() != triangles || mesh->mesh->num_points() != points)
            return "its Draco stream has other triangles or points than its accessors count";
        for (uint32_t f = 0; f < triangles; f++)
            for (int c = 0; c < 3; c++)
                if (mesh->mesh->face(draco::FaceIndex(f))[c].value() >= points)
                    return "its Draco stream is damaged";
        *out = mesh.release();
        return nullptr;
    } catch (const std::exception &) {
        return "its Draco stream is damaged, or takes more memory than there is";
    }
}

extern "C" void draco_mesh_free(struct draco_mesh *mesh) { delete mesh; }

extern "C" void draco_mesh_indices(const struct draco_mesh *mesh, uint32_t *out)
{
    for (uint32_t f = 0; f < mesh->mesh->num_faces(); f++)
        for (int c = 0; c < 3; c++)
            *out++ = mesh->mesh->face(draco::FaceIndex(f))[c].value();
}

extern "C" const char *draco_mesh_attribute(const struct draco_mesh *mesh, uint32_t id, int components,
                                            enum draco_type type, void *out)
{
    const draco::PointAttribute *from = mesh->mesh->GetAttributeByUniqueId(id);
    bool good = false;

    if (!from)
        return "its Draco stream has no such attribute";
    if (from->num_components() != components)
        return "its Draco stream has another number of components";
    switch (type) {
    case DRACO_INT8: good = read_all(*mesh->mesh, *from, components, static_cast<int8_t *>(out)); break;
    case DRACO_UINT8: good = read_all(*mesh->mesh, *from, components, static_cast<uint8_t *>(out)); break;
    case DRACO_INT16: good = read_all(*mesh->mesh, *from, components, static_cast<int16_t *>(out)); break;
    case DRACO_UINT16: good = read_all(*mesh->mesh, *from, components, static_cast<uint16_t *>(out)); break;
    case DRACO_UINT32: good = read_all(*mesh->mesh, *from, components, static_cast<uint32_t *>(out)); break;
    case DRACO_FLOAT: good = read_all(*mesh->mesh, *from, components, static_cast<float *>(out)); break;
    }
    return good ? nullptr : "its Draco stream holds values of another type";
}
