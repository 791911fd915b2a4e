//! Documents against JSON schemas, by an independent validator.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use boon::{Compiler, SchemaIndex, Schemas};
use serde_json::Value;

use crate::root;

/// A schema that is ready to use.
pub struct Schema {
    schemas: Schemas,
    index: SchemaIndex,
}

impl Schema {
    /// The schema of the first of some documents, by their addresses: the others are what it
    /// refers to.
    pub fn new(documents: impl IntoIterator<Item = (String, Value)>) -> Self {
        let (mut schemas, mut compiler) = (Schemas::new(), Compiler::new());
        let mut first = None;
        for (address, document) in documents {
            compiler.add_resource(&address, document).expect("an address");
            first.get_or_insert(address);
        }
        let index = compiler.compile(&first.expect("a schema"), &mut schemas);
        Self { index: index.expect("a valid schema"), schemas }
    }

    /// What breaks the schema in a document; none where it follows.
    pub fn error(&self, document: &Value) -> Option<String> {
        self.schemas.validate(document, self.index).err().map(|error| format!("{error:#}"))
    }
}

/// Holds a report to the schema of its verb.
pub fn assert_schema(verb: &str, report: &Value) {
    assert_eq!(report["schema"], format!("mipvog-{verb}/1"));
    assert_follows(verb, report);
}

/// Holds a document to a schema in `formats/`.
pub fn assert_follows(name: &str, document: &Value) {
    static MADE: Mutex<BTreeMap<String, Arc<Schema>>> = Mutex::new(BTreeMap::new());
    let make = || {
        let schema = std::fs::read(root().join(format!("formats/{name}.schema.json")));
        let schema = serde_json::from_slice(&schema.expect("a schema")).expect("JSON");
        Arc::new(Schema::new([(format!("memory:///{name}"), schema)]))
    };
    let mut made = MADE.lock().expect("no panic before");
    let schema = Arc::clone(made.entry(name.to_owned()).or_insert_with(make));
    drop(made);
    if let Some(error) = schema.error(document) {
        panic!("{name}: {error}");
    }
}
