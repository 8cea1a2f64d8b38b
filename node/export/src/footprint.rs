//! Memory that the code needs on a processor: flash, state and stack, from the files that GCC writes beside an object.

use crate::source::CSource;
use std::collections::BTreeMap;

/// Options of the compiler on every processor: it optimises for size, and writes a file `NAME.ci` of calls and stack.
pub const OPTIONS: [&str; 5] = ["-std=c99", "-Os", "-ffunction-sections", "-fcallgraph-info=su", "-c"];

/// A C file whose only variable is the state of one damper.
#[must_use]
pub fn probe(source: &CSource) -> String {
    format!("#include \"{0}.h\"\n{0}_state state;\n", source.name)
}

/// Bytes of code with constants, of initialised and of zeroed variables, from what `size` prints for one object.
#[must_use]
pub fn sizes(printed: &str) -> Option<[u64; 3]> {
    let mut numbers = printed.lines().nth(1)?.split_whitespace().map(str::parse);
    let mut next = || numbers.next()?.ok();
    Some([next()?, next()?, next()?])
}

/// Bytes of stack that `function` takes with all that it calls in its file, from GCC's file of calls (`-fcallgraph-info=su`). Routines of
/// the compiler's library come on top. `None` if the file has no such function, or if no bound is known: for a recursion, or a frame whose
/// size depends on data.
///
/// ```
/// use mr_damper_export::footprint::stack;
///
/// let calls = r#"graph: { title: "a.c"
/// node: { title: "a.c:inner" label: "inner\na.c:1:1\n40 bytes (static)" }
/// node: { title: "outer" label: "outer\na.c:5:1\n16 bytes (static)" }
/// edge: { sourcename: "outer" targetname: "a.c:inner" label: "a.c:6:1" }
/// edge: { sourcename: "a.c:inner" targetname: "__aeabi_dmul" }
/// }"#;
/// assert_eq!((stack(calls, "outer"), stack(calls, "other")), (Some(56), None));
/// ```
#[must_use]
pub fn stack(calls: &str, function: &str) -> Option<u64> {
    let quoted = |line: &str, key: &str| -> Option<String> {
        let (_, rest) = line.split_once(&format!("{key}: \""))?;
        rest.split_once('"').map(|(text, _)| text.to_owned())
    };
    let (mut frames, mut edges) = (BTreeMap::new(), BTreeMap::<String, Vec<String>>::new());
    for line in calls.lines() {
        if line.starts_with("node:") {
            let (title, label) = (quoted(line, "title")?, quoted(line, "label")?);
            // A routine of the library has no frame here.
            let frame = match label.rsplit("\\n").next()?.split_once(" bytes (") {
                Some((bytes, "static)")) => bytes.parse().ok()?,
                Some(_) => return None,
                None => 0,
            };
            frames.insert(title, frame);
        } else if line.starts_with("edge:") {
            edges.entry(quoted(line, "sourcename")?).or_default().push(quoted(line, "targetname")?);
        }
    }
    frames.get(function)?;
    // The last call may be of a routine that has no node.
    deepest(function, &frames, &edges, frames.len() + 1)
}

/// The same for a node; `None` below more calls than there are functions.
fn deepest(
    node: &str,
    frames: &BTreeMap<String, u64>,
    edges: &BTreeMap<String, Vec<String>>,
    left: usize,
) -> Option<u64> {
    let left = left.checked_sub(1)?;
    let mut called: Vec<&String> = edges.get(node).into_iter().flatten().collect();
    called.sort_unstable();
    called.dedup();
    let below = called.into_iter().map(|next| deepest(next, frames, edges, left));
    let most = below.collect::<Option<Vec<u64>>>()?.into_iter().max().unwrap_or(0);
    Some(frames.get(node).copied().unwrap_or(0) + most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recursion_and_a_frame_without_a_bound_have_no_stack() {
        let node = |name: &str, kind: &str| {
            format!("node: {{ title: \"{name}\" label: \"{name}\\n1\\n8 bytes ({kind})\" }}\n")
        };
        let edge = "edge: { sourcename: \"f\" targetname: \"f\" }\n";
        assert_eq!(stack(&node("f", "static"), "f"), Some(8));
        assert_eq!(stack(&(node("f", "static") + edge), "f"), None);
        assert_eq!(stack(&node("f", "dynamic"), "f"), None);
    }

    #[test]
    fn sizes_are_those_of_the_second_line() {
        let printed = "   text\t   data\t    bss\t    dec\n   8082\t      0\t    336\t   8418\n";
        assert_eq!(sizes(printed), Some([8082, 0, 336]));
        assert_eq!(sizes("text\n"), None);
    }
}
