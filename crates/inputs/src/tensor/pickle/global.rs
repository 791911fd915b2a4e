//! The supported names. Objects of other names are not built.

use crate::model::grid::Element;

/// A Python function or class that state dictionaries need.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Global {
    /// `collections.OrderedDict`
    OrderedDict,
    /// `torch._utils._rebuild_tensor` and `_rebuild_tensor_v2`: storage, offset, size, stride.
    RebuildTensor,
    /// `torch._utils._rebuild_tensor_v3`: the same, with the element type as seventh argument.
    RebuildTensorV3,
    /// `torch._utils._rebuild_parameter` and its like: the tensor itself, the first argument.
    RebuildParameter,
    /// `torch._tensor._rebuild_from_type_v2`: a function, a class, the function's arguments.
    RebuildFromType,
    /// `collections.defaultdict`: an ordinary dictionary when only read.
    DefaultDict,
    /// `collections.Counter`: likewise.
    Counter,
    /// `set` and `frozenset`: lists when only read.
    Set,
    /// `torch.FloatStorage` and its like; without a type `UntypedStorage`.
    Storage(Option<Element>),
    /// `torch.float32` and its like.
    ElementType(Element),
    /// `torch.Size`
    Size,
    /// `torch.device`
    Device,
    /// `numpy.ndarray`, only as an argument.
    NumpyArray,
    /// `numpy.dtype`
    NumpyType,
    /// `numpy._core.multiarray._reconstruct`
    NumpyReconstruct,
    /// `numpy._core.multiarray.scalar`
    NumpyScalar,
    /// `numpy._core.numeric._frombuffer`
    NumpyFromBuffer,
    /// `_codecs.encode`: bytes in protocol 2.
    Encode,
    /// `bytes`: empty bytes in protocol 2.
    Bytes,
}

impl Global {
    /// The global of this name, if supported.
    pub(super) fn find(module: &str, name: &str) -> Option<Self> {
        Some(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_tensor_v3") => Self::RebuildTensorV3,
            (
                "torch._utils",
                "_rebuild_parameter"
                | "_rebuild_parameter_with_state"
                | "_rebuild_device_tensor_from_cpu_tensor",
            ) => Self::RebuildParameter,
            ("torch._tensor", "_rebuild_from_type_v2") => Self::RebuildFromType,
            ("collections", "defaultdict") => Self::DefaultDict,
            ("collections", "Counter") => Self::Counter,
            ("__builtin__" | "builtins", "set" | "frozenset") => Self::Set,
            ("torch", "Size") => Self::Size,
            ("torch", "device") => Self::Device,
            ("torch" | "torch.cuda" | "torch.storage", "UntypedStorage") => Self::Storage(None),
            ("torch" | "torch.cuda", _) => match name.strip_suffix("Storage") {
                Some(class) => Self::Storage(Some(storage_element(class)?)),
                None => Self::ElementType(type_element(name)?),
            },
            ("numpy", "ndarray") => Self::NumpyArray,
            ("numpy", "dtype") => Self::NumpyType,
            ("numpy._core.multiarray" | "numpy.core.multiarray", "_reconstruct") => {
                Self::NumpyReconstruct
            }
            ("numpy._core.multiarray" | "numpy.core.multiarray", "scalar") => Self::NumpyScalar,
            ("numpy._core.numeric" | "numpy.core.numeric", "_frombuffer") => Self::NumpyFromBuffer,
            ("_codecs", "encode") => Self::Encode,
            ("__builtin__" | "builtins", "bytes") => Self::Bytes,
            _ => return None,
        })
    }
}

fn storage_element(class: &str) -> Option<Element> {
    Some(match class {
        "Half" => Element::F16,
        "BFloat16" => Element::BF16,
        "Float" => Element::F32,
        "Double" => Element::F64,
        "Bool" => Element::Bool,
        "Byte" => Element::U8,
        "Char" => Element::I8,
        "Short" => Element::I16,
        "Int" => Element::I32,
        "Long" => Element::I64,
        _ => return None,
    })
}

fn type_element(name: &str) -> Option<Element> {
    Some(match name {
        "float16" | "half" => Element::F16,
        "bfloat16" => Element::BF16,
        "float32" | "float" => Element::F32,
        "float64" | "double" => Element::F64,
        "bool" => Element::Bool,
        "uint8" => Element::U8,
        "int8" => Element::I8,
        "int16" | "short" => Element::I16,
        "int32" | "int" => Element::I32,
        "int64" | "long" => Element::I64,
        _ => return None,
    })
}
