//! `type_description_interfaces`: descriptions of message types for peers that do not know them (REP-2016).

use serde::{Deserialize, Serialize};

use crate::definition::{definition, text};
use crate::message::{message, service};

/// `type_description_interfaces/msg/FieldType`: the type of a field.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FieldType {
    /// REP-2016 id: the base type, plus 48 for an array, 96 for a bounded and 144 for an unbounded sequence.
    pub type_id: u8,
    /// Length of an array, or maximum length of a bounded sequence.
    pub capacity: u64,
    /// Maximum string length; 0 means unbounded.
    pub string_capacity: u64,
    /// Full name of the nested message type.
    pub nested_type_name: String,
}
message!(
    FieldType,
    "type_description_interfaces" / "msg" / "FieldType",
    "a70b6dd919645a03a3586f7f821defbc886ea3e531a1d95cc0f380a3973ccaa6",
    text!(FieldType)
);

/// `type_description_interfaces/msg/Field`: one field of a type.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Its type.
    pub r#type: FieldType,
    /// Its default value as text; not part of the hash.
    pub default_value: String,
}
message!(
    Field,
    "type_description_interfaces" / "msg" / "Field",
    "c0b01379cd4226281285ccaf6be46653968f855f7c5e41614ff5d7a854efef7c",
    definition!(text!(Field), FieldType)
);

/// `type_description_interfaces/msg/IndividualTypeDescription`: a type without its nested types.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndividualTypeDescription {
    /// Its full name.
    pub type_name: String,
    /// Its fields, in order.
    pub fields: Vec<Field>,
}
message!(
    IndividualTypeDescription,
    "type_description_interfaces" / "msg" / "IndividualTypeDescription",
    "55c827d86c3c141bdd318fe6c22e11190e4d3b37c8f4f9751a084aa05ce96560",
    definition!(text!(IndividualTypeDescription), Field FieldType)
);

/// `type_description_interfaces/msg/TypeDescription`: a type with its nested types.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeDescription {
    /// The type.
    pub type_description: IndividualTypeDescription,
    /// The nested types at any depth, by name.
    pub referenced_type_descriptions: Vec<IndividualTypeDescription>,
}
message!(
    TypeDescription,
    "type_description_interfaces" / "msg" / "TypeDescription",
    "739f2508c9fa3a6f330913ff5b9d25fb74159a077da71e1087f51a60c12a080b",
    definition!(text!(TypeDescription), IndividualTypeDescription Field FieldType)
);

/// `type_description_interfaces/msg/TypeSource`: the text that defines a type.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TypeSource {
    /// Its full name.
    pub type_name: String,
    /// Format of the text: `msg`.
    pub encoding: String,
    /// The text.
    pub raw_file_contents: String,
}
message!(
    TypeSource,
    "type_description_interfaces" / "msg" / "TypeSource",
    "faeaec7596c04ecf5b6e99ad225e4c7cbb997ad5435f793526fb3984d011aae5",
    text!(TypeSource)
);

/// `type_description_interfaces/msg/KeyValue`: an additional piece of information.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// Its name.
    pub key: String,
    /// Its value.
    pub value: String,
}
message!(
    KeyValue,
    "type_description_interfaces" / "msg" / "KeyValue",
    "274fe56bf14f33c7512e34c646a37579ee36779f745f049a9760763e817f0c42",
    text!(TypeKeyValue)
);

service! {
    /// `type_description_interfaces/srv/GetTypeDescription`: the description of a type that a node uses.
    GetTypeDescription("type_description_interfaces", "69b9c19c1021405984cc60dbbb1edceb147a6538b411d812ba6afabeed962cd5"):
        GetTypeDescriptionRequest => GetTypeDescriptionResponse
}

/// Request of [`GetTypeDescription`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetTypeDescriptionRequest {
    /// Full name of the type.
    pub type_name: String,
    /// Type hash; empty matches any.
    pub type_hash: String,
    /// Whether to include the defining texts.
    pub include_type_sources: bool,
}
message!(
    GetTypeDescriptionRequest,
    "type_description_interfaces" / "srv" / "GetTypeDescription_Request",
    "470f56ccbcf13d55c78c8b735fb12da03e639e5acded994426c89d94778d9e28",
    "string type_name\nstring type_hash\nbool include_type_sources\n"
);

/// Response of [`GetTypeDescription`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetTypeDescriptionResponse {
    /// Whether the node uses such a type.
    pub successful: bool,
    /// On failure, the cause.
    pub failure_reason: String,
    /// The type.
    pub type_description: TypeDescription,
    /// The texts that define the type and all nested types.
    pub type_sources: Vec<TypeSource>,
    /// Empty in this node's responses.
    pub extra_information: Vec<KeyValue>,
}
message!(
    GetTypeDescriptionResponse,
    "type_description_interfaces" / "srv" / "GetTypeDescription_Response",
    "648c49d976240861a482f961c5621ddd0d2135d8cce6f297a76d4f6376d93b75",
    definition!(
        "bool successful\nstring failure_reason\nTypeDescription type_description\nTypeSource[] type_sources\nKeyValue[] extra_information\n",
        TypeDescription IndividualTypeDescription Field FieldType TypeSource TypeKeyValue
    )
);
