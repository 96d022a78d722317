//! What a thread of a pass does, counted in its code as naga reads it.

use std::collections::BTreeSet;

use naga::valid::{FunctionInfo, ModuleInfo};
use naga::{AddressSpace, Block, Expression, Function, Handle, MathFunction, Module, Statement, TypeInner};

use super::{BYTES, INSTRUCTIONS, LOAD, LOOPS, THREADS_AT_ONCE};

/// What a thread does.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Work {
    pub instructions: f64,
    pub bytes: f64,
    pub loads: f64,
    /// The turns of all loops together.
    pub turns: f64,
}

impl Work {
    fn add(&mut self, more: Self, times: f64) {
        self.instructions += more.instructions * times;
        self.bytes += more.bytes * times;
        self.loads += more.loads * times;
        self.turns += more.turns * times;
    }

    /// The milliseconds that so many threads take.
    pub fn milliseconds(self, threads: f64) -> f64 {
        let waves = (threads / THREADS_AT_ONCE).ceil();
        let seconds = (self.instructions * threads / INSTRUCTIONS)
            .max(self.bytes * threads / BYTES)
            .max(self.loads * LOAD * waves);
        seconds * 1e3
    }
}

/// The code of a pass.
pub(super) struct Code<'a> {
    pub module: &'a Module,
    pub info: &'a ModuleInfo,
    pub pass: &'static str,
    /// The loops that run more or less often than `LOOPS` says.
    pub changed: Vec<(&'static str, usize, f64)>,
    /// The functions whose loops are not listed.
    pub unlisted: Vec<String>,
    /// The rows of `LOOPS` that were taken.
    pub taken: BTreeSet<&'static str>,
}

impl Code<'_> {
    pub fn of_function(&mut self, function: &Function, info: &FunctionInfo) -> Work {
        let name = function.name.clone().unwrap_or_default();
        let own = format!("{}.{name}", self.pass);
        let row = |name: &str| LOOPS.iter().find(|(known, _)| *known == name);
        let row = row(&own).or_else(|| row(&name)).filter(|_| has_loops(&function.body));
        self.taken.extend(row.map(|(name, _)| *name));
        let mut times = row.map_or(Vec::new(), |(_, times)| times.to_vec());
        for (_, place, factor) in self.changed.iter().filter(|(changed, ..)| *changed == name) {
            times[*place] *= factor;
        }
        let mut loops = &times[..];
        let mut work = Work::default();
        self.of_block(&function.body, (function, info), &mut loops, &mut work);
        if !loops.is_empty() {
            self.unlisted.push(format!("{name} has fewer loops"));
        }
        work
    }

    fn of_block(&mut self, block: &Block, place: (&Function, &FunctionInfo), loops: &mut &[f64], work: &mut Work) {
        let (function, info) = place;
        for statement in block {
            match statement {
                Statement::Emit(range) => {
                    for expression in range.clone() {
                        self.of_expression(expression, place, work);
                    }
                }
                Statement::Block(block) => self.of_block(block, place, loops, work),
                Statement::If { accept, reject, .. } => {
                    work.instructions += 1.0;
                    self.of_block(accept, place, loops, work);
                    self.of_block(reject, place, loops, work);
                }
                Statement::Switch { cases, .. } => {
                    work.instructions += cases.len() as f64;
                    cases.iter().for_each(|case| self.of_block(&case.body, place, loops, work));
                }
                Statement::Loop { body, continuing, .. } => {
                    let times = loops.split_off_first().copied().unwrap_or_else(|| {
                        self.unlisted.push(function.name.clone().unwrap_or_default());
                        1.0
                    });
                    let mut turn = Work { instructions: 1.0, turns: 1.0, ..Work::default() };
                    self.of_block(body, place, loops, &mut turn);
                    self.of_block(continuing, place, loops, &mut turn);
                    work.add(turn, times);
                }
                Statement::Call { function, .. } => {
                    let called = self.of_function(&self.module.functions[*function], &self.info[*function]);
                    work.add(called, 1.0);
                }
                Statement::Store { pointer, value } => {
                    let (lanes, bytes) = self.size_of(*value, info);
                    match self.space_of(*pointer, function) {
                        AddressSpace::Storage { .. } => work.bytes += bytes,
                        _ => work.instructions += lanes,
                    }
                }
                Statement::ImageStore { value, .. } => {
                    work.instructions += 1.0;
                    work.bytes += self.size_of(*value, info).1;
                }
                // A sector of memory is read and written.
                Statement::Atomic { pointer, .. } => match self.space_of(*pointer, function) {
                    AddressSpace::WorkGroup => work.instructions += 8.0,
                    _ => work.add(Work { instructions: 1.0, bytes: 64.0, ..Work::default() }, 1.0),
                },
                Statement::ControlBarrier(_) | Statement::MemoryBarrier(_) => work.instructions += 16.0,
                _ => work.instructions += 1.0,
            }
        }
    }

    fn of_expression(&self, handle: Handle<Expression>, (function, info): (&Function, &FunctionInfo), work: &mut Work) {
        let lanes = || self.size_of(handle, info).0;
        work.instructions += match &function.expressions[handle] {
            Expression::Load { pointer } => {
                match self.space_of(*pointer, function) {
                    AddressSpace::Storage { .. } => {
                        work.bytes += self.size_of(handle, info).1;
                        work.loads += 1.0;
                        1.0
                    }
                    // What is the same for all threads, and registers.
                    AddressSpace::Uniform | AddressSpace::Function | AddressSpace::Private => 0.0,
                    _ => 1.0,
                }
            }
            Expression::ImageLoad { .. } => {
                work.bytes += 16.0;
                work.loads += 1.0;
                4.0
            }
            Expression::Unary { .. }
            | Expression::Binary { .. }
            | Expression::Select { .. }
            | Expression::As { .. } => lanes(),
            Expression::Relational { argument, .. } => self.size_of(*argument, info).0,
            Expression::Math { fun, arg, .. } => {
                let lanes = self.size_of(*arg, info).0;
                match fun {
                    MathFunction::Sqrt
                    | MathFunction::InverseSqrt
                    | MathFunction::Exp
                    | MathFunction::Exp2
                    | MathFunction::Log
                    | MathFunction::Log2
                    | MathFunction::Sin
                    | MathFunction::Cos => 4.0 * lanes,
                    MathFunction::Pow
                    | MathFunction::Tan
                    | MathFunction::Acos
                    | MathFunction::Asin
                    | MathFunction::Atan
                    | MathFunction::Atan2 => 16.0 * lanes,
                    MathFunction::Normalize | MathFunction::Length | MathFunction::Distance => 3.0 * lanes + 4.0,
                    MathFunction::Cross | MathFunction::Mix | MathFunction::Reflect => 3.0 * lanes,
                    _ => lanes,
                }
            }
            _ => 0.0,
        };
    }

    /// The numbers and the bytes of a value.
    fn size_of(&self, value: Handle<Expression>, info: &FunctionInfo) -> (f64, f64) {
        let inner = info[value].ty.inner_with(&self.module.types);
        let lanes = match inner {
            TypeInner::Vector { size, .. } => f64::from(*size as u8),
            TypeInner::Matrix { columns, rows, .. } => f64::from(*columns as u8 * *rows as u8),
            _ => 1.0,
        };
        (lanes, f64::from(inner.size(self.module.to_ctx())))
    }

    /// Where what a pointer points to lies.
    fn space_of(&self, pointer: Handle<Expression>, function: &Function) -> AddressSpace {
        match &function.expressions[pointer] {
            Expression::Access { base, .. } | Expression::AccessIndex { base, .. } => self.space_of(*base, function),
            Expression::GlobalVariable(variable) => self.module.global_variables[*variable].space,
            _ => AddressSpace::Function,
        }
    }
}

/// Whether a block has loops of its own.
fn has_loops(block: &Block) -> bool {
    block.iter().any(|statement| match statement {
        Statement::Loop { .. } => true,
        Statement::Block(block) => has_loops(block),
        Statement::If { accept, reject, .. } => has_loops(accept) || has_loops(reject),
        Statement::Switch { cases, .. } => cases.iter().any(|case| has_loops(&case.body)),
        _ => false,
    })
}
