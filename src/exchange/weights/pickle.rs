//! What `torch.save` writes of a state dict: a zip archive with a pickle of names, shapes and storages, and the storages' bytes. Of
//! pickle's machine there is what such a file needs; what it calls is compared with the few names that make tensors and dicts, and
//! nothing is imported or run.

use super::StateDict;
use crate::npz::entries;
use m4gn_base::{Error, Result};
use m4gn_model::Tensor;
use safetensors::Dtype;
use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

/// Reads the tensors of the dict in the file, or of the dict that it has under `state_dict`, `model_state_dict` or `model`.
pub(super) fn read(path: &Path) -> Result<StateDict> {
    let wanted = |name: &str| name.ends_with("/data.pkl") || name.contains("/data/");
    let entries = entries(path, wanted)?;
    let Some((name, pickle)) = entries.iter().find(|e| e.0.ends_with("/data.pkl")) else {
        return Err(Error::file(
            path,
            "has no data.pkl: expected what torch.save writes (PyTorch 1.6 or later)",
        ));
    };
    let folder = name.trim_end_matches("data.pkl");
    let storages =
        entries.iter().filter_map(|e| Some((e.0.strip_prefix(folder)?.strip_prefix("data/")?, &e.1[..])));
    let mut machine =
        Machine { bytes: pickle, at: 0, stack: Vec::new(), memo: HashMap::new(), dicts: Vec::new() };
    let wrong = |(at, what): (usize, String)| Error::file(path, format!("{name}, its byte {at}: {what}"));
    let top = machine.run().map_err(wrong)?;
    machine.tensors(&top, &storages.collect(), 0).map_err(|what| Error::file(path, what))
}

/// Numbers behind a tensor.
#[derive(Clone)]
struct Storage {
    kind: Dtype,
    key: Rc<str>,
}

/// What stands on the machine's stack. Copies are cheap.
#[derive(Clone)]
enum Value {
    Number(i64),
    Text(Rc<str>),
    /// With how deep tuples are in it.
    Tuple(Rc<[Value]>, usize),
    /// Place among the machine's dicts.
    Dict(usize),
    Global(Rc<str>),
    Storage(Storage),
    Tensor(Rc<(Storage, [Vec<usize>; 2], usize)>),
    Mark,
    Other,
}

/// Most tuples in each other: what is dropped by recursion stays small. A state dict has two.
const DEEPEST: usize = 32;

fn tuple(values: Vec<Value>) -> std::result::Result<Value, String> {
    let depth = |v: &Value| if let Value::Tuple(_, depth) = v { *depth } else { 0 };
    match 1 + values.iter().map(depth).max().unwrap_or(0) {
        depth if depth > DEEPEST => {
            Err(format!("more than {DEEPEST} tuples in each other, which no state dict has"))
        }
        depth => Ok(Value::Tuple(values.into(), depth)),
    }
}

/// What is wrong, and at which byte.
type Step<T> = std::result::Result<T, (usize, String)>;

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Value>,
    memo: HashMap<u32, Value>,
    dicts: Vec<Vec<(Value, Value)>>,
}

impl<'a> Machine<'a> {
    /// What is left when it stops.
    fn run(&mut self) -> Step<Value> {
        loop {
            let start = self.at;
            let code = self.take(1)?[0];
            match code {
                b'.' => return self.pop(),
                // Protocol, frame
                0x80 => drop(self.take(1)?),
                0x95 => drop(self.take(8)?),
                b'(' => self.stack.push(Value::Mark),
                b'}' => {
                    let dict = self.dict();
                    self.stack.push(dict);
                }
                b')' => self.stack.push(Value::Tuple([].into(), 1)),
                b'N' | 0x88 | 0x89 | b']' => self.stack.push(Value::Other),
                b'G' => {
                    self.take(8)?;
                    self.stack.push(Value::Other);
                }
                b'K' | b'M' | b'J' | 0x8a => {
                    let n = match code {
                        b'K' => 1,
                        b'M' => 2,
                        b'J' => 4,
                        _ => self.take(1)?[0].into(),
                    };
                    let bytes = self.take(n)?;
                    let negative = bytes.last().is_some_and(|b| b & 128 != 0) && matches!(code, b'J' | 0x8a);
                    if n > 8 {
                        return Err((start, format!("a whole number of {n} bytes, expected at most 8")));
                    }
                    let fill = if negative { -1 } else { 0 };
                    let number = bytes.iter().rev().fold(fill, |n: i64, b| n << 8 | i64::from(*b));
                    self.stack.push(Value::Number(number));
                }
                b'X' | 0x8c => {
                    let n = if code == b'X' { self.number(4)? as usize } else { self.take(1)?[0].into() };
                    let text = String::from_utf8_lossy(self.take(n)?);
                    self.stack.push(Value::Text(text.into()));
                }
                b'c' => {
                    let (module, name) = (self.line()?, self.line()?);
                    self.stack.push(Value::Global(format!("{module}.{name}").into()));
                }
                b'q' | b'r' | 0x94 => {
                    let place = match code {
                        b'q' => self.take(1)?[0].into(),
                        b'r' => self.number(4)? as u32,
                        _ => self.memo.len() as u32,
                    };
                    let top =
                        self.stack.last().cloned().ok_or_else(|| (start, "an empty stack".to_string()))?;
                    self.memo.insert(place, top);
                }
                b'h' | b'j' => {
                    let place = if code == b'h' { self.take(1)?[0].into() } else { self.number(4)? as u32 };
                    let value = self.memo.get(&place).cloned();
                    self.stack.push(value.ok_or_else(|| (start, format!("nothing was kept as {place}")))?);
                }
                b't' => {
                    let values = self.down_to_mark()?;
                    self.stack.push(tuple(values).map_err(|what| (start, what))?);
                }
                0x85..=0x87 => {
                    let n = usize::from(code - 0x84);
                    let mut values = (0..n).map(|_| self.pop()).collect::<Step<Vec<_>>>()?;
                    values.reverse();
                    self.stack.push(tuple(values).map_err(|what| (start, what))?);
                }
                b's' | b'u' => {
                    let pairs = match code {
                        b's' => {
                            let value = self.pop()?;
                            vec![self.pop()?, value]
                        }
                        _ => self.down_to_mark()?,
                    };
                    match self.stack.last() {
                        Some(Value::Dict(d)) => {
                            let pairs = pairs.as_chunks().0.iter().map(|[k, v]| (k.clone(), v.clone()));
                            self.dicts[*d].extend(pairs);
                        }
                        _ => return Err((start, "items of something that is no dict".into())),
                    }
                }
                // Items of lists, which weights do not need, and attributes of dicts
                b'a' | b'b' => drop(self.pop()?),
                b'e' => drop(self.down_to_mark()?),
                b'Q' => {
                    let id = self.pop()?;
                    self.stack.push(storage(&id).map_err(|what| (start, what))?);
                }
                b'R' => {
                    let (arguments, called) = (self.pop()?, self.pop()?);
                    let value = self.call(&called, &arguments).map_err(|what| (start, what))?;
                    self.stack.push(value);
                }
                other => {
                    return Err((
                        start,
                        format!("pickle's operation 0x{other:02x}, which no state dict needs"),
                    ));
                }
            }
        }
    }

    fn take(&mut self, n: usize) -> Step<&'a [u8]> {
        let end = self.at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| (self.at, format!("{n} bytes needed, the pickle ends before")))?;
        let bytes = &self.bytes[self.at..end];
        self.at = end;
        Ok(bytes)
    }

    fn number(&mut self, n: usize) -> Step<u64> {
        Ok(self.take(n)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    }

    fn line(&mut self) -> Step<String> {
        let n = self.bytes[self.at..].iter().position(|b| *b == b'\n');
        let n = n.ok_or_else(|| (self.at, "a line without end".to_string()))?;
        let line = String::from_utf8_lossy(&self.take(n + 1)?[..n]).into_owned();
        Ok(line)
    }

    fn pop(&mut self) -> Step<Value> {
        self.stack.pop().ok_or_else(|| (self.at, "an empty stack".to_string()))
    }

    fn down_to_mark(&mut self) -> Step<Vec<Value>> {
        let mark = self.stack.iter().rposition(|v| matches!(v, Value::Mark));
        let mark = mark.ok_or_else(|| (self.at, "no mark on the stack".to_string()))?;
        let values = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(values)
    }

    fn dict(&mut self) -> Value {
        self.dicts.push(Vec::new());
        Value::Dict(self.dicts.len() - 1)
    }

    /// The few things that are called.
    fn call(&mut self, called: &Value, arguments: &Value) -> std::result::Result<Value, String> {
        let (Value::Global(name), Value::Tuple(arguments, _)) = (called, arguments) else {
            return Err("a call of something that has no name".into());
        };
        let extents = |value: &Value| match value {
            Value::Tuple(values, _) => values.iter().map(whole).collect::<Option<Vec<_>>>(),
            _ => None,
        };
        match (&name[..], &arguments[..]) {
            ("collections.OrderedDict", []) => Ok(self.dict()),
            ("torch._utils._rebuild_tensor_v2", [Value::Storage(storage), offset, shape, strides, ..]) => {
                match (whole(offset), extents(shape), extents(strides)) {
                    (Some(offset), Some(shape), Some(strides)) if shape.len() == strides.len() => {
                        Ok(Value::Tensor(Rc::new((storage.clone(), [shape, strides], offset))))
                    }
                    _ => Err("a tensor without a usable shape".into()),
                }
            }
            ("torch._utils._rebuild_parameter", [tensor @ Value::Tensor(_), ..]) => Ok(tensor.clone()),
            (other, _) => Err(format!(
                "it calls {other}, which is not run: save the weights alone, torch.save(model.state_dict(), ...)"
            )),
        }
    }

    /// The tensors of a dict, or of one that is in it.
    fn tensors(
        &self,
        top: &Value,
        storages: &HashMap<&str, &[u8]>,
        depth: usize,
    ) -> std::result::Result<StateDict, String> {
        let Value::Dict(dict) = top else {
            return Err("holds no dict: save the weights alone, torch.save(model.state_dict(), ...)".into());
        };
        let named = self.dicts[*dict].iter().filter_map(|(key, value)| match key {
            Value::Text(name) => Some((&name[..], value)),
            _ => None,
        });
        let (mut found, mut inner, mut room) =
            (StateDict::new(), None, storages.values().map(|s| s.len()).sum());
        for (name, value) in named {
            match value {
                // Counters of layers that are no weights of ours
                Value::Tensor(tensor) if tensor.0.kind == Dtype::I64 => {}
                Value::Tensor(tensor) => {
                    let tensor = gather(tensor, storages, &mut room)
                        .map_err(|what| format!("tensor '{name}': {what}"))?;
                    found.insert(name.to_string(), tensor);
                }
                Value::Dict(_) if ["state_dict", "model_state_dict", "model"].contains(&name) => {
                    inner = Some(value)
                }
                _ => {}
            }
        }
        match (found.is_empty(), inner) {
            (true, Some(inner)) if depth < 4 => self.tensors(inner, storages, depth + 1),
            (true, _) => Err("its dict holds no tensors".into()),
            (false, _) => Ok(found),
        }
    }
}

fn whole(value: &Value) -> Option<usize> {
    match value {
        Value::Number(n) => usize::try_from(*n).ok(),
        _ => None,
    }
}

/// The storage of a persistent id: `('storage', torch.FloatStorage, key, device, count)`.
fn storage(id: &Value) -> std::result::Result<Value, String> {
    let Value::Tuple(parts, _) = id else { return Err("a persistent id that is no tuple".into()) };
    let [Value::Text(what), Value::Global(kind), Value::Text(key), ..] = &parts[..] else {
        return Err("a persistent id of another form".into());
    };
    let dtype = match (&what[..], &kind[..]) {
        ("storage", "torch.FloatStorage") => Dtype::F32,
        ("storage", "torch.DoubleStorage") => Dtype::F64,
        ("storage", "torch.LongStorage") => Dtype::I64,
        _ => return Err(format!("a {what} of {kind}, expected one of single or double precision")),
    };
    Ok(Value::Storage(Storage { kind: dtype, key: key.clone() }))
}

/// A tensor's numbers in row-major order. All tensors together take no more numbers than the storages have bytes.
fn gather(
    tensor: &(Storage, [Vec<usize>; 2], usize),
    storages: &HashMap<&str, &[u8]>,
    room: &mut usize,
) -> std::result::Result<Tensor, String> {
    let (storage, [shape, strides], offset) = tensor;
    let bytes = storages
        .get(&storage.key[..])
        .ok_or_else(|| format!("its numbers, data/{}, are missing", storage.key))?;
    // Tensors may share a storage: of each the numbers that it has are read, and no others.
    let size = if storage.kind == Dtype::F64 { 8 } else { 4 };
    let wrong =
        || format!("shape {shape:?}, strides {strides:?} at {offset} of {} numbers", bytes.len() / size);
    let count = shape.iter().try_fold(1usize, |a, n| a.checked_mul(*n)).filter(|n| n <= room);
    let count = count.ok_or_else(wrong)?;
    *room -= count;
    let number = |i: usize| {
        let (mut rest, mut place) = (i, *offset);
        for (n, stride) in shape.iter().zip(strides).rev() {
            place = place.checked_add((rest % n).checked_mul(*stride)?)?;
            rest /= n;
        }
        let start = place.checked_mul(size)?;
        let bytes = bytes.get(start..start.checked_add(size)?)?;
        match storage.kind {
            Dtype::F64 => bytes.try_into().ok().map(|b| f64::from_le_bytes(b) as f32),
            _ => bytes.try_into().ok().map(f32::from_le_bytes),
        }
    };
    let data: Option<Vec<f32>> = (0..count).map(number).collect();
    Ok(Tensor { shape: shape.clone(), data: data.ok_or_else(wrong)? })
}
